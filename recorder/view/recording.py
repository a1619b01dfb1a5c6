"""A recording of rerun (.rrd), entities named as our frames, all times on one timeline; and its viewer."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import DeviceError, MissingDependencyError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from carlaloc_env.core.transforms import matrix_to_quat, quat_rotate
from carlaloc_env.scene.semantic_tags import PALETTE_RGB, Tag

SUFFIX = ".rrd"
"""Suffix of rerun's files."""
TIMELINE = "stamp"
"""The one timeline: Unix time, as in the files of a dataset."""
WORLD, BASE_LINK = "world", "world/base_link"
"""Entities of the world (ENU) and of the car; its sensors lie below it, by the names of their frames."""


class Recording:
    """Open recording of one file; times are Unix times [ns], coordinates metres in the entity's frame.

    Args:
        stream: Stream of rerun.
        rerun: The library.
    """

    def __init__(self, stream: Any, rerun: ModuleType) -> None:
        self.rerun: Any = rerun
        self._stream = stream

    def always(self, entity: str, thing: Any, *more: Any) -> None:
        """Log values that hold at all times."""
        self._stream.log(entity, thing, *more, static=True, strict=True)

    def at(self, stamp_ns: int, entity: str, thing: Any) -> None:
        """Log values that begin to hold at one time [ns]."""
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        self._stream.log(entity, thing, strict=True)
        self._stream.reset_time()

    def columns(self, entity: str, stamp_ns: NDArray[np.int64], columns: Any) -> None:
        """Log many times at once: an archetype's ``columns(...)``, a row for each time [ns]."""
        index = self.rerun.TimeColumn(TIMELINE, timestamp=stamp_ns.astype("datetime64[ns]"))
        self._stream.send_columns(entity, indexes=[index], columns=columns, strict=True)

    def motion(self, entity: str, stamp_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> None:
        """Log poses that map the entity's frame to its parent's, positions (N, 3), quaternions (N, 4)."""
        transforms = self.rerun.Transform3D.columns(translation=position_m, quaternion=quat_xyzw)
        self.columns(entity, stamp_ns, transforms)

    def mount(self, entity: str, T: Array) -> None:
        """Log a pose that never changes: maps the entity's frame to its parent's, shape (4, 4)."""
        quat: Any = matrix_to_quat(T[:3, :3])
        self.always(entity, self.rerun.Transform3D(translation=T[:3, 3], quaternion=quat))

    def path(self, entity: str, position_m: Array, colour: tuple[int, int, int], radius_m: float) -> None:
        """Log a line through positions (N, 3) that is always there."""
        self.always(entity, self.rerun.LineStrips3D([position_m], colors=[colour], radii=[radius_m]))

    def world_view(self, position_m: Array, quat_xyzw: Array) -> Any:
        """A view of the world whose eye stands first behind and above a pose of the car."""
        blueprint = self.rerun.blueprint
        behind_m = position_m + quat_rotate(quat_xyzw, [-22.0, 0.0, 14.0])
        target_m = position_m + quat_rotate(quat_xyzw, [10.0, 0.0, 0.0])
        eye = blueprint.EyeControls3D(position=behind_m, look_target=target_m, eye_up=(0, 0, 1))
        return blueprint.Spatial3DView(origin=WORLD, name="world", eye_controls=eye)

    def show(self, *views: Any) -> None:
        """Lay views out, the first one twice as wide as the others, which stand below each other."""
        blueprint = self.rerun.blueprint
        side = blueprint.Vertical(*views[1:])
        shown = blueprint.Horizontal(views[0], side, column_shares=[2, 1]) if len(views) > 1 else views[0]
        self._stream.send_blueprint(blueprint.Blueprint(shown, collapse_panels=True))


def import_rerun() -> ModuleType:
    """Import rerun, with its blueprints.

    Raises:
        MissingDependencyError: it is not installed.
    """
    try:
        import rerun
        import rerun.blueprint
    except ImportError as error:
        raise MissingDependencyError('rerun is not installed; pip install "carlaloc[view]"') from error
    library: ModuleType = rerun
    return library


@contextmanager
def new_recording(path: str | Path, title: str, *, overwrite: bool = False) -> Iterator[Recording]:
    """Open a recording, whose file is whole, or not there, when the block ends.

    Args:
        path: New file (.rrd).
        title: What the viewer calls it.
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the file may not be written.
        MissingDependencyError: rerun is not installed.
    """
    path = check_output_file(path, suffixes=(SUFFIX,), overwrite=overwrite)
    rerun: Any = import_rerun()
    with atomic_write(path) as part:
        stream = rerun.RecordingStream("CarlaLoc", send_properties=False)
        stream.save(part)
        stream.send_recording_name(title)
        recording = Recording(stream, rerun)
        recording.always(WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, rerun.AnnotationContext(_classes()))
        yield recording
        stream.flush()
        stream.disconnect()


def _classes() -> list[tuple[int, str, tuple[int, ...]]]:
    """Semantic tags with CARLA's names and colours."""
    return [(int(tag), tag.name.lower(), tuple(PALETTE_RGB[tag].tolist())) for tag in Tag]


def check_display() -> None:
    """Check that a window can be opened.

    Raises:
        DeviceError: there is no display.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise DeviceError(
            "there is no display for rerun's viewer; write a recording with --out FILE.rrd and open that "
            "elsewhere with: rerun FILE.rrd"
        )


def open_viewer(recording: Path) -> None:
    """Show a recording until the viewer is closed.

    It listens to this machine alone, not to all of the network, which is its own default.

    Raises:
        DeviceError: the viewer ended with an error.
    """
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--new", str(recording)]
    status = subprocess.run(words, check=False).returncode
    if status:
        raise DeviceError(f"rerun's viewer ended with exit status {status}; its messages are above")
