"""Refuses a process forked from one in which JAX had started: there JAX would wait for ever.

A fork copies memory but none of JAX's threads, whose answers the copy would await. A fork before
JAX has started is harmless.
"""

import os
import sys

from lanewise.errors import LanewiseError

_process: int | None = None
"""Which process forked last with JAX started, as the processes forked from it remember it."""


def refuse() -> None:
    """Does nothing, but in a process that can no longer use JAX.

    Raises:
        LanewiseError: JAX had started in the process that this one was forked from.
    """
    if _process is not None and _process != os.getpid():
        raise LanewiseError(
            "this process was forked from one that had used JAX, and JAX would wait for ever.\n"
            'Start processes by "spawn", such as AsyncVectorEnv(..., context="spawn"), or use '
            'gymnasium.make_vec("lanewise/Trap-v0", num_envs), which needs none.'
        )


def watch() -> None:
    """Remember from now on whether JAX had started before a fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=_note)


def _note() -> None:
    global _process
    # Not imported here, where it would take half a second; nor does JAX say so anywhere else.
    bridge = sys.modules.get("jax._src.xla_bridge")
    if bridge is not None and bridge.backends_are_initialized():
        _process = os.getpid()
