"""Where a result comes from: code, versions and machine."""

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lanewise.system import process
from lanewise.system.version import commit_of
from lanewise.system.version import source as source

PACKAGES = ("lanewise", "jax", "jaxlib", "optax", "numpy", "gymnasium", "highway-env")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages a result depends on, as far as installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def commits(sources: Sequence[Mapping[str, Any]]) -> str:
    """Short names of the commits behind some results, without repetition."""
    return ", ".join(dict.fromkeys(map(commit_of, sources)))


def trained_by(sources: Sequence[Mapping[str, Any]]) -> str:
    """Which code trained some runs, and whether it trains alike, in a line; empty for no runs.

    Args:
        sources: what each run remembers of its code (`version.recorded`).
    """
    if not sources:
        return ""
    names = {source.get("training") for source in sources}
    shown = ", ".join(f"`{name}`" for name in sorted(filter(None, names)))
    if None in names:
        verdict = "whether training is the same is not recorded"
    elif len(names) == 1:
        verdict = f"training is the same ({shown})"
    else:
        verdict = f"**training differs** ({shown})"
    said = commits(sources)
    return f"Trained by {'more than one: ' if ', ' in said else ''}{said}; {verdict}."


def machine() -> dict[str, Any]:
    """What the system tells about the machine; no name that would tell whose it is."""
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "processor": _processor(),
        "cores": len(process.usable_cores()),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
