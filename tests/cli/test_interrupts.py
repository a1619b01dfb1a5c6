"""An interrupt ends a command even where Python drops the exception on its way."""

import gc
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress

import pytest

from recorder.cli.interrupts import ended_as_by_ctrl_c, raise_again
from recorder.cli.progress import Progress

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals as on POSIX")

NUMBERS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def _as_at_a_terminal() -> Iterator[None]:
    """Handlers as at a terminal; under nohup SIGHUP would be ignored from the start, and stay so."""
    handlers = [signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL]
    before = [signal.signal(number, handler) for number, handler in zip(NUMBERS, handlers, strict=True)]
    yield
    for number, handler in zip(NUMBERS, before, strict=True):
        signal.signal(number, handler)


class _Dropping:
    """An object during whose removal a signal comes in; Python only prints what it raises."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


def _drop(number: signal.Signals) -> None:
    """Let a signal come in whose exception Python drops."""
    dropped = _Dropping(number)
    del dropped
    gc.collect()


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_ends_a_command(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), ended_as_by_ctrl_c():
        signal.raise_signal(number)
    assert signal.getsignal(number) is before


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_dropped_interrupt_is_raised_again(number: signal.Signals) -> None:
    with Progress("driving") as progress, suppress(KeyboardInterrupt), ended_as_by_ctrl_c():
        progress.update(0.0)
        _drop(number)
        with pytest.raises(KeyboardInterrupt):
            progress.update(0.25)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("number", NUMBERS)
def test_a_command_that_ran_on_does_not_end_as_done(number: signal.Signals) -> None:
    """The interrupt was dropped behind its last look."""
    with pytest.raises(KeyboardInterrupt), ended_as_by_ctrl_c():
        _drop(number)


def test_nothing_is_raised_unasked() -> None:
    before = signal.getsignal(signal.SIGINT)
    raise_again()
    with ended_as_by_ctrl_c():
        assert signal.getsignal(signal.SIGINT) is not before
        raise_again()
    assert signal.getsignal(signal.SIGINT) is before


def test_what_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_as_by_ctrl_c():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            signal.raise_signal(signal.SIGHUP)
            raise_again()
    finally:
        signal.signal(signal.SIGHUP, before)
