"""A Ctrl-C at any instruction of the writer: the file holds every tick once, up to where it ends."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import mcap.writer
import numpy as np

from recorder.episode import mcap_container, writer
from recorder.episode.ego_messages import EgoRow
from recorder.episode.episode import open_episode
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter

TICKS = 200
WATCHED = {mcap_container.__file__, writer.__file__, mcap.writer.__file__}
OF_A_TICK = {"ego", "_check_open", "_flush_in_time"}
"""Functions that run at every tick."""
ROW = EgoRow(position_m=np.arange(3.0), quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]))

Trace = Callable[[FrameType, str, Any], Any]


def tracer(seen: list[str], stop_at: int | None = None) -> Trace:
    """A tracer that notes the functions of the writer's instructions, and raises at one of them."""

    def local(frame: FrameType, event: str, _: Any) -> Any:
        if event == "opcode":
            seen.append(frame.f_code.co_name)
            if len(seen) == stop_at:
                raise KeyboardInterrupt
        return local

    def begin(frame: FrameType, event: str, _: Any) -> Any:
        if frame.f_code.co_filename not in WATCHED:
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return local

    return begin


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


def test_interrupted_at_any_instruction(tmp_path: Path) -> None:
    """All instructions of the cut of a chunk, which comes every 0.9 s, and a few hundred of those between."""
    seen: list[str] = []
    drive(tmp_path / "whole.mcap", tracer(seen))
    cuts = [k + 1 for k, name in enumerate(seen) if name not in OF_A_TICK]
    between = [k + 1 for k, name in enumerate(seen) if name in OF_A_TICK]
    assert 20 < len(cuts) < 200
    for place in (*cuts, *between[::53]):
        path = tmp_path / f"{place}.mcap"
        done = drive(path, tracer([], place))
        kept = len(open_episode(path).ego)
        assert done <= kept <= done + 1, f"instruction {place}, in {seen[place - 1]}: {kept} of {done} ticks"
