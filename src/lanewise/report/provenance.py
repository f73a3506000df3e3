"""Where a result comes from: code, versions and machine."""

import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lanewise.system import process
from lanewise.system.version import commit_of
from lanewise.system.version import source as source

PACKAGES = ("lanewise", "jax", "jaxlib", "optax", "numpy", "gymnasium", "highway-env")


def origin() -> dict[str, Any]:
    """Of a result that is made now: date, code, versions and machine."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return {"date": date, **source(), "versions": versions(), "machine": machine()}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages a result depends on, as far as installed."""
    found = {name: number for name, number in installed(PACKAGES).items() if number}
    return {"python": platform.python_version(), **found}


def installed(packages: Iterable[str]) -> dict[str, str]:
    """The version of each package; empty where it is not installed."""
    found = dict.fromkeys(packages, "")
    for name in found:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def commits(sources: Sequence[Mapping[str, Any]]) -> str:
    """Short names of the commits behind some results, without repetition."""
    return ", ".join(dict.fromkeys(map(commit_of, sources)))


def trained_by(sources: Sequence[Mapping[str, Any]]) -> str:
    """A line on which code trained some runs (`version.recorded`), and whether it trains alike."""
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
        "processor": _processor() or platform.processor(),
        "cores": len(process.usable_cores()),
    }


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return ""
