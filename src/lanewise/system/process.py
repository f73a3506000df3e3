"""This process: its cores and memory, the signals that end it, and its forks. Imports no JAX."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from lanewise.errors import LanewiseError

Handler = Callable[[int, FrameType | None], object]

ENDING = (signal.SIG_DFL, signal.default_int_handler)
"""Handlers of a signal that ends the program."""

_forked_from: int | None = None
"""The process that forked last after JAX had started, as its forks remember it."""


def usable_cores() -> list[int]:
    """Numbers of the cores this process may use, in order; all of them where that is unknown."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def total_memory() -> int | None:
    """Memory of the machine in bytes; None where the system does not tell."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


@contextmanager
def handle_signal(number: signal.Signals, handler: Handler) -> Iterator[None]:
    """Call ``handler`` for a signal that would otherwise end the program.

    Nothing changes where the signal is ignored, as in a shell's background, where the caller has a
    handler already, and outside the main thread, where Python cannot set one.
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


@contextmanager
def interrupts(hear: Callable[[], object]) -> Iterator[Callable[[], bool]]:
    """Within it, Ctrl-C and SIGTERM only ask to stop; a second one does not wait.

    By SIGTERM clusters announce that a machine is needed otherwise. ``hear`` is called at the
    first; the function yielded tells whether there was one.
    """
    asked = False

    def handle(*_: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        with suppress(RuntimeError):  # In the middle of another line.
            hear()

    with handle_signal(signal.SIGINT, handle), handle_signal(signal.SIGTERM, handle):
        yield lambda: asked


def refuse_forked() -> None:
    """Refuse to use JAX in a process forked after JAX had started, where it would hang.

    A fork copies memory but none of JAX's threads, and the copy waits for their answers. A fork
    before JAX has started is harmless.
    """
    if _forked_from is not None and _forked_from != os.getpid():
        raise LanewiseError(
            "this process was forked from one that had used JAX, and JAX would wait for ever.\n"
            'Start processes by "spawn", such as AsyncVectorEnv(..., context="spawn"), or use '
            'gymnasium.make_vec("lanewise/Trap-v0", num_envs), which needs none.'
        )


def watch_forks() -> None:
    """From now on, remember at each fork whether JAX had started."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=_remember_fork)


def _remember_fork() -> None:
    global _forked_from
    # JAX is not imported here, which would take half a second; it has no public name for this.
    bridge = sys.modules.get("jax._src.xla_bridge")
    if bridge is not None and bridge.backends_are_initialized():
        _forked_from = os.getpid()
