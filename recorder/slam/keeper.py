"""Runs a command and ends all that it has started: ``python keeper.py COMMAND…``.

Its exit status or signal is the command's, and its processor time, as Linux reports it, that of all of them.
It runs by its path and imports nothing of ours.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

GRACE_S = {signal.SIGINT: 5.0, signal.SIGTERM: 3.0, signal.SIGKILL: 3.0}
"""How long processes may take to end after each signal [s]."""
NOT_STARTED = 127
"""Status where the command is not there, as a shell has it."""
_POLL_S = 0.02
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


def kept(words: Sequence[str]) -> list[str]:
    """Words of a command line that runs another one under this program."""
    return [sys.executable, "-I", "-S", str(Path(__file__).resolve()), *words]


def descendants(pid: int) -> list[int]:
    """Processes below one, by Linux's ``/proc``; elsewhere none."""
    pids: list[int] = []
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                pids += [int(child), *descendants(int(child))]
    return pids


def main(words: Sequence[str]) -> int:
    """Run the command, end all that it has started, and return its exit status or minus its signal.

    Orphans become children of this process, which is their subreaper, in whatever session they hide. When the
    command ends, or this process gets SIGINT or SIGTERM, or its parent dies, all that still runs gets SIGINT,
    after `GRACE_S` SIGTERM and at last SIGKILL.
    """
    asked: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: asked.append(number))
    _adopt_orphans()
    try:
        child = os.posix_spawnp(words[0], list(words), os.environ)
    except OSError as error:
        print(f"cannot start {words[0]}: {error.strerror}", file=sys.stderr)  # noqa: T201
        return NOT_STARTED
    status: int | None = None
    while status is None and not asked:
        time.sleep(_POLL_S)
        status = _reaped(child)
    _end_all(child, running=status is None)
    return -asked[0] if status is None else status


def _adopt_orphans() -> None:
    if sys.platform == "linux":
        system = ctypes.CDLL(None, use_errno=True)
        system.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        system.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def _reaped(child: int) -> int | None:
    """Wait for all that has ended; exit status of the command if it is among them."""
    status_of_child = None
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return status_of_child
        if pid == 0:
            return status_of_child
        if pid == child:
            status_of_child = os.waitstatus_to_exitcode(status)


def _end_all(child: int, *, running: bool) -> None:
    for number, grace_s in GRACE_S.items():
        signalled: set[int] = set()
        until = time.monotonic() + grace_s
        while time.monotonic() < until:
            running = _reaped(child) is None and running
            left = set(descendants(os.getpid())) | ({child} if running else set())
            if not left:
                return
            for pid in left - signalled:
                # It may have ended since it was seen.
                with suppress(ProcessLookupError):
                    os.kill(pid, number)
            signalled |= left
            time.sleep(_POLL_S)


if __name__ == "__main__":
    ended = main(sys.argv[1:])
    if ended < 0:
        # The command has dumped its core, if it was to.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with suppress(OSError):  # SIGKILL cannot be handled anyway
            signal.signal(-ended, signal.SIG_DFL)
        os.kill(os.getpid(), -ended)
    sys.exit(ended)
