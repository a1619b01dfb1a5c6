"""The end of a command on request: Ctrl-C, SIGTERM and a closed terminal all raise KeyboardInterrupt."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn


class InterruptHandler:
    """A signal handler that raises KeyboardInterrupt and remembers that it did.

    Python drops an exception that rises in a finaliser or in a callback from C. Long work therefore
    asks from time to time (`raise_again`) whether it has to end.
    """

    def __init__(self) -> None:
        self.was_called = False

    def __call__(self, number: int, frame: FrameType | None) -> NoReturn:
        """Take a signal.

        Raises:
            KeyboardInterrupt: always.
        """
        self.was_called = True
        raise KeyboardInterrupt


@contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and a closed terminal end a command as Ctrl-C does, so that it cleans up.

    Raises:
        KeyboardInterrupt: a signal came, also where it was dropped on its way and the command ran to its end.
    """
    handler = InterruptHandler()
    before: dict[int, Any] = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # Under nohup a closed terminal is ignored, and stays so.
        wanted = (signal.SIG_DFL, signal.default_int_handler)
        if number is not None and signal.getsignal(number) in wanted and _in_main_thread():
            before[number] = signal.signal(number, handler)
    try:
        yield
        raise_again()
    finally:
        for number, former in before.items():
            signal.signal(number, former)


def raise_again() -> None:
    """Raise an interrupt that came and was dropped on its way.

    Raises:
        KeyboardInterrupt: a signal has asked the command to end.
    """
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, InterruptHandler) and handler.was_called and _in_main_thread():
        raise KeyboardInterrupt


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
