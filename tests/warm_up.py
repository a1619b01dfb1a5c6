"""Build and compile once what two processes of tests would both begin with, outside any limit of time.

`make test` runs it in a fresh environment: Town03 and its traffic, and the compiled functions of a drive and
a replay. They stay in the caches of the user; what is there already is only read.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from carlaloc_env.core.errors import RaycastError, RenderError
from recorder.drive.record import RecordConfig, record
from recorder.replaying.replay import ReplayConfig, replay


def say(what: str) -> None:
    """Print what is done next, and the seconds of processor time so far."""
    times = os.times()
    sys.stdout.write(f"warm up: {what} ({sum(times[:4]):.0f} s of processor time so far)\n")
    sys.stdout.flush()


def main() -> None:
    """Drive one second of Town03 among little traffic, and replay an instant of it."""
    with TemporaryDirectory() as folder:
        drive = Path(folder, "drive.mcap")
        say("building Town03, compiling what drives in it")
        record(RecordConfig(map="Town03", out=drive, duration_s=1.0, traffic="0.2"))
        say("compiling what senses and draws")
        config = ReplayConfig(
            episode=drive, out=Path(folder, "data"), rig="paper", weathers=("HardRainNight",), start_s=0.5,
            duration_s=0.1, quality="low", workers=1, preview=False,
        )  # fmt: skip
        try:
            replay(config)
        except (RenderError, RaycastError) as missing:
            say(f"left out, {missing}")
    say("done")


if __name__ == "__main__":
    main()
