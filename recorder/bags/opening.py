"""Opening a bag of any kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.bags.files import files_of_bag
from recorder.bags.type_stores import add_definitions

_CURES = {
    "not indexed": "{bag} was not closed by its recorder and has no index; run: rosbag reindex {bag}",
    "File end magic": "{bag} was cut off and lacks its end; run: mcap recover {bag} -o whole.mcap",
    "Profile is not ros2": "{bag} is an MCAP, but not of ROS 2; convert it to a bag of ROS 2 first",
}
"""What to do about what rosbags says, by a part of its words."""


@contextmanager
def open_bag(bag: Path) -> Iterator[AnyReader]:
    """A reader of a bag: a file (.bag, .mcap, .db3, also .zstd), or the folder of a ROS 2 or a split bag.

    Raises:
        EvaluationError: it is missing or damaged, was not closed, or is several bags.
    """
    with ExitStack() as stack:
        scratch = stack.enter_context(TemporaryDirectory(prefix="carlaloc-bag-"))
        with refused_in_one_line(bag):
            paths = files_of_bag(bag, Path(scratch))
            reader = stack.enter_context(AnyReader(paths, default_typestore=get_typestore(Stores.EMPTY)))
            if reader.is2:
                add_definitions(reader, paths[0], bag)
        yield reader


@contextmanager
def refused_in_one_line(bag: Path) -> Iterator[None]:
    """Around what reads a bag.

    Raises:
        EvaluationError: it raised anything.
    """
    try:
        yield
    except CarlaLocError:
        raise
    # A damaged bag makes the library raise whatever its parts do: struct, zlib, assertions, …
    except Exception as error:
        for words, cure in _CURES.items():
            if words in str(error):
                raise EvaluationError(cure.format(bag=bag)) from error
        why = f" ({error})" if isinstance(error, AnyReaderError) else ""
        raise EvaluationError(
            f"cannot read {bag}: no ROS bag, or a damaged one; give another{why}"
        ) from error
