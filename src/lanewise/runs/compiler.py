"""Switches by which the compiler rounds otherwise, so that a run would go on to other bits.

They hold for a whole process, so they cannot be set aside as those of `lanewise.pinned` are: a run
remembers them instead. Imports no JAX.
"""

import os

_ROUNDING = ("fast_math", "optimization_level")
"""Parts of names in ``XLA_FLAGS``."""
_UNOPTIMISED = "JAX_DISABLE_MOST_OPTIMIZATIONS"


def switches() -> tuple[str, ...]:
    """Those that are set now, as they are written, in order; mostly none."""
    given = os.environ.get("XLA_FLAGS", "").split()
    found = [f"XLA_FLAGS={flag}" for flag in given if any(name in flag for name in _ROUNDING)]
    if os.environ.get(_UNOPTIMISED, "0").lower() in ("1", "y", "yes", "t", "true", "on"):
        found.append(f"{_UNOPTIMISED}=1")
    return tuple(sorted(found))
