"""The cores this process may use. Imports no JAX."""

import os


def usable() -> list[int]:
    """Their numbers, in order; all of the machine's where the system does not tell."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
