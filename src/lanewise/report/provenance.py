"""Where a result comes from: code, versions and machine."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lanewise import cores
from lanewise.version import source as source

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


def machine() -> dict[str, Any]:
    """What the system tells about the machine; no name that would tell whose it is."""
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "processor": _processor(),
        "cores": len(cores.usable()),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
