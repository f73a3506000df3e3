"""Compiled calls on several cores at once; XLA computes the loops of each on one."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from lanewise.system import process
from lanewise.world.materialize import on_cpu

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"
"""Of ``XLA_FLAGS``: where it makes XLA compute on one core, so do we."""

Given = TypeVar("Given")
Result = TypeVar("Result")


def in_order(
    call: Callable[[Given], Result],
    given: Iterable[Given],
    done: Callable[[int], None] = lambda count: None,
) -> list[Result]:
    """The results of a compiled call for each of the given, in their order.

    ``done`` is called after each with their number. The first is made alone, so that only one
    compiles. Threads suffice: compiled programs run outside Python's lock.
    """
    first, *rest = given
    results = [call(first)]
    done(1)
    pool = ThreadPoolExecutor(threads())
    try:
        for result in pool.map(call, rest):
            results.append(result)
            done(len(results))
    finally:
        # So that Ctrl-C does not wait for all that has not begun.
        pool.shutdown(cancel_futures=True)
    return results


def threads() -> int:
    """Calls that are worth making at once."""
    if not on_cpu() or ONE_THREAD in os.environ.get("XLA_FLAGS", ""):
        return 1
    return len(process.usable_cores())
