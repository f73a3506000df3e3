"""What is installed, what is missing for which feature, and what to do about it."""

import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module  # noqa: TID251, names from Lanewise's metadata
from importlib.metadata import packages_distributions, requires
from typing import Any

from lanewise.report import provenance
from lanewise.system.extras import install

FEATURES = {
    "": "training, tests, environments",
    "report": "pictures, clips, report pages",
    "highway": "tests and environment in the real highway-env",
    "tensorboard": "TensorBoard's events, train --tensorboard",
    "onnx": "export to ONNX",
    "cuda13": "NVIDIA GPUs",
}
"""By extra, what it is for; the first needs no extra."""
FINE, MISSING, BROKEN = "ok", "missing", "broken"
REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?([^;]*)(?:;.*extra == ['\"](\w+)['\"])?")
"""Of a package's metadata: a name, which versions, for which extra."""


@dataclass(frozen=True)
class InstallationFinding:
    """One feature."""

    feature: str
    status: str
    """``ok``, ``missing`` or ``broken``."""
    packages: dict[str, str]
    """Version by package; empty where it is not installed."""
    advice: str
    """One line; empty where there is nothing to do."""


def examine() -> Iterator[InstallationFinding]:
    """Each feature in turn."""
    wanted: dict[str, dict[str, str]] = {}
    for line in requires("lanewise") or []:
        if match := REQUIREMENT.match(line):
            name, versions, extra = match.groups()
            wanted.setdefault(extra or "", {})[name] = versions.strip()
    for extra, feature in FEATURES.items():
        packages = {} if extra == "cuda13" else provenance.installed(wanted[extra])
        found = _gpu() if extra == "cuda13" else _status(extra, wanted[extra], packages)
        yield InstallationFinding(feature, found[0], packages, found[1])


def _status(extra: str, wanted: dict[str, str], packages: dict[str, str]) -> tuple[str, str]:
    """Whether an extra's packages are there and work, and what to do."""
    remedy = install(extra) if extra else install()
    if missing := [name for name, number in packages.items() if not number]:
        return MISSING if extra else BROKEN, f"{remedy} brings {', '.join(missing)}"
    for name, number in packages.items():
        pinned = re.fullmatch(r"==([\w.]+)", wanted[name])
        if pinned and number != pinned[1]:
            return BROKEN, f"{remedy}: {name} {pinned[1]} is needed, {number} is here"
        if error := _failure(name):
            return BROKEN, f"{name} does not import ({error}); {remedy} again"
    return FINE, ""


def _gpu() -> tuple[str, str]:
    """Whether a GPU that is there is used, and what to do."""
    if devices()["backend"] == "gpu":
        return FINE, ""
    if shutil.which("nvidia-smi"):
        advice = f"JAX computes on the CPU; {install('cuda13')} for the GPU that is here"
        return MISSING, advice
    return MISSING, "no NVIDIA GPU here; all works on CPUs"


@cache
def _owners() -> Mapping[str, list[str]]:
    """The installed packages that each module comes from."""
    return packages_distributions()


def _failure(distribution: str) -> str:
    """Why a package cannot be imported; empty if it can."""
    for module, owners in _owners().items():
        named = {owner.replace("-", "_").lower() for owner in owners}
        if module.startswith("_") or distribution.replace("-", "_").lower() not in named:
            continue
        try:
            import_module(module)
        except Exception as error:  # whatever a broken package raises
            return (str(error).splitlines() or [type(error).__name__])[0][:100]
        break
    return ""


def devices() -> dict[str, Any]:
    """What JAX computes on."""
    import jax

    return {"backend": jax.default_backend(), "devices": [str(one) for one in jax.devices()]}


def text(machine: dict[str, Any], findings: list[InstallationFinding]) -> str:
    """For a terminal."""
    versions = provenance.versions()
    lines = [
        f"lanewise {versions['lanewise']}, Python {versions['python']}, {machine['system']} "
        f"{machine['architecture']}",
        f"{machine['processor']}, {machine['cores']} cores, JAX computes on {machine['backend']}",
        "",
    ]
    width = max(len(one.feature) for one in findings)
    for one in findings:
        packages = ", ".join(f"{name} {number}" for name, number in one.packages.items() if number)
        lines.append(f"{one.feature:<{width}}  {one.status:<7}  {packages}".rstrip())
        if one.advice:
            lines.append(f"{'':<{width}}  {one.advice}")
    return "\n".join(lines) + "\n"
