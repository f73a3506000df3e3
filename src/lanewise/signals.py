"""Signals that end a program: Ctrl-C (SIGINT), and SIGTERM, by which machines are cleared."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]

ENDING = (signal.SIG_DFL, signal.default_int_handler)
"""What a signal does where nobody has said otherwise: it ends the program."""


@contextmanager
def heard(number: signal.Signals, handler: Handler) -> Iterator[None]:
    """For a while a signal that would end the program calls ``handler`` instead.

    Nothing is changed where the signal is ignored, as in a shell's background, where somebody has a
    handler of their own, and outside the main thread, where handlers cannot be set.
    """
    before = signal.getsignal(number)
    if threading.current_thread() is not threading.main_thread() or before not in ENDING:
        yield
        return
    signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)
