"""A Ctrl-C at any line of the writer: the file holds every tick once, up to where it ends."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from recorder.episode import mcap_container, writer
from recorder.episode.ego_messages import EgoRow
from recorder.episode.episode import open_episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter

TICKS = 200
WATCHED = {mcap_container.__file__, writer.__file__}
ROW = EgoRow(position_m=np.arange(3.0), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]))

Trace = Callable[[FrameType, str, Any], Any]


def tracer(seen: list[str], stop_at: int | None = None) -> Trace:
    """A tracer that notes the functions of the writer's lines, and raises at one of them.

    The turns of a comprehension are one line: from Python 3.12 on they belong to the function around it.
    """
    last: tuple[str, int] | None = None

    def local(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal last
        place = (frame.f_code.co_name, frame.f_lineno)
        if event == "line" and place != last:
            last = place
            seen.append(place[0])
            if len(seen) == stop_at:
                raise KeyboardInterrupt
        return local

    return lambda frame, event, _: local if frame.f_code.co_filename in WATCHED else None


def drive(path: Path, trace: Trace) -> int:
    """Record until the end or an interrupt; the number of ticks that were recorded."""
    recorder = EpisodeWriter(path, EpisodeHeader(map_name="Town03"), durable=False)
    done, before = 0, sys.gettrace()
    sys.settrace(trace)
    try:
        for tick in range(TICKS):
            recorder.ego(tick, ROW)
            done = tick + 1
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(before)
    recorder.abandon()
    return done


def test_interrupted_at_any_line(tmp_path: Path) -> None:
    """Every line of the cut of a chunk, which comes every 0.9 s, and a few hundred of those between."""
    seen: list[str] = []
    drive(tmp_path / "whole.mcap", tracer(seen))
    cuts = [k + 1 for k, name in enumerate(seen) if name in ("close_chunk", "flush", "_append")]
    between = [k + 1 for k, name in enumerate(seen) if name not in ("close_chunk", "flush", "_append")]
    assert 20 < len(cuts) < 200
    for line in (*cuts, *between[::13]):
        path = tmp_path / f"{line}.mcap"
        done = drive(path, tracer([], line))
        kept = len(open_episode(path).ego)
        assert done <= kept <= done + 1, f"line {line}, in {seen[line - 1]}: {kept} of {done} ticks"
