"""ROS 1 nodes by a description: what they read and publish, and the process that feeds them."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.scene.semantic_tags import DYNAMIC_TAGS
from recorder.dataset.sequence import SEGMENTED, SlamSequence
from recorder.slam.keeper import kept
from recorder.slam.runners.command import filled, poses_in, program_path
from recorder.slam.system import FrameClock, StampedPose

PYTHON = "CARLALOC_ROS1_PYTHON"
"""Environment variable: the Python that has rospy, if not the system's."""
_PLAYER = Path(__file__).with_name("play.py")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros1Node:
    """A node, or a launch file of several."""

    poses: str
    """Topic on which it publishes its poses, messages with a header."""
    pace: str
    """Topic of the bag whose messages it answers: one is sent, then it is waited for."""
    command: tuple[str, ...]
    """Program and words, with ``{calibration}`` and the like (`recorder.slam.runners.command`)."""
    remap: Mapping[str, str] = field(default_factory=dict)
    """Topics of the bag, each with the name by which the node reads it."""
    every: int = 1
    """It gives a pose for one of so many messages, so that no more are expected of it."""
    patience_s: float = 2.0
    """Rest after which no answer is expected any more [s], see `recorder.slam.ros1.lock_step`."""
    silence_s: float = 60.0
    """Time without a pose after which it is ended [s]."""

    def __post_init__(self) -> None:
        for name in ("every", "patience_s", "silence_s"):
            if getattr(self, name) <= 0:
                raise ConfigError(f"{name} is {getattr(self, name)}; give a number above 0")

    def run(self, sequence: SlamSequence, clock: FrameClock, *, sensor: str) -> list[StampedPose]:
        """Poses that it publishes, fed with a sequence's bag in lock-step.

        Args:
            sequence: What it reads.
            clock: Receives the run's time, shared out over the frames.
            sensor: What makes a frame: ``lidar`` or ``stereo``.

        Raises:
            EvaluationError: ROS 1 is not there, or the node ended, hung or gave no pose.
        """
        if sequence.bag.suffix != ".bag":
            raise EvaluationError(f"{sequence.bag} is no bag of ROS 1; replay with --format rosbag1")
        with tempfile.TemporaryDirectory() as folder:
            out, work = Path(folder, "poses.bag"), Path(folder, "work")
            work.mkdir()
            words = filled(self._player(sequence.cloud), sequence, {"{out_bag}": out, "{work}": work})
            clock.due = sequence.frames(sensor) // self.every
            with clock.frame(clock.due):
                _play(words)
            return poses_in(out, topic=self.poses)

    def _player(self, cloud: str) -> list[str]:
        python = os.environ.get(PYTHON, "/usr/bin/python3")
        words = [python, str(_PLAYER), "{bag}", "{out_bag}", self.poses, self.pace]
        words += ["--patience", f"{self.patience_s:g}", "--silence", f"{self.silence_s:g}"]
        for topic, name in self.remap.items():
            words += ["--remap", f"{topic}={name}"]
        if cloud == SEGMENTED:
            words += [f"--without={tag:d}" for tag in sorted(DYNAMIC_TAGS)]
        return [*words, "--", *self.command]


def _play(words: list[str]) -> None:
    environment = {**os.environ, "PATH": program_path()}
    player = subprocess.run(
        kept(words), stderr=subprocess.PIPE, text=True, errors="replace", check=False, env=environment
    )
    sys.stderr.write(player.stderr)
    if player.returncode:
        lines = [line for line in player.stderr.splitlines() if line.strip()]
        raise EvaluationError(f"{lines[-1] if lines else 'the player of ROS 1 ended'}; see log.txt")
