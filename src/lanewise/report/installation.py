"""What is installed, what is missing for which feature, and what to do about it."""

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from typing import Any

from lanewise.extras import install
from lanewise.report import provenance

FEATURES = {
    "": "training, tests, environments",
    "report": "pictures, clips, report pages",
    "highway": "tests and environment in the real highway-env",
    "tensorboard": "TensorBoard's events, train --tensorboard",
    "onnx": "export to ONNX",
    "cuda13": "NVIDIA GPUs",
}
"""By extra, what it is for; the first needs none."""
CORE, FINE, MISSING, BROKEN = "", "ok", "missing", "broken"
REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?([^;]*)(?:;.*extra == ['\"](\w+)['\"])?")
"""Of a package's metadata: a name, which versions, for which extra."""


@dataclass(frozen=True)
class Finding:
    """One feature."""

    feature: str
    status: str
    """``ok``, ``missing`` or ``broken``."""
    packages: dict[str, str]
    """Version by package; empty where it is not installed."""
    advice: str
    """One line; empty where there is nothing to do."""


def examine() -> Iterator[Finding]:
    """Each feature in turn."""
    wanted = _requirements()
    for extra, feature in FEATURES.items():
        if extra == "cuda13":
            yield _gpu(feature)
        else:
            yield _finding(extra, feature, wanted.get(extra, {}))


def _requirements() -> dict[str, dict[str, str]]:
    """Which versions of which packages, by extra, as this installation says itself."""
    found: dict[str, dict[str, str]] = {}
    for line in requires("lanewise") or []:
        if match := REQUIREMENT.match(line):
            name, versions, extra = match.groups()
            found.setdefault(extra or CORE, {})[name] = versions.strip()
    return found


def _finding(extra: str, feature: str, wanted: dict[str, str]) -> Finding:
    packages = {name: _version(name) for name in wanted}
    missing = [name for name, number in packages.items() if not number]
    remedy = install(extra) if extra else install()
    if missing:
        status = MISSING if extra else BROKEN
        return Finding(feature, status, packages, f"{remedy} brings {', '.join(missing)}")
    for name, number in packages.items():
        pinned = re.fullmatch(r"==([\w.]+)", wanted[name])
        if pinned and number != pinned[1]:
            advice = f"{remedy}: {name} {pinned[1]} is needed, {number} is here"
            return Finding(feature, BROKEN, packages, advice)
        if error := _failure(name):
            advice = f"{name} does not import ({error}); {remedy} again"
            return Finding(feature, BROKEN, packages, advice)
    return Finding(feature, FINE, packages, "")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _failure(distribution: str) -> str:
    """Why a package cannot be imported; empty if it can."""
    wanted = distribution.replace("-", "_").lower()
    modules = [
        module
        for module, owners in packages_distributions().items()
        if not module.startswith("_")
        and wanted in (owner.replace("-", "_").lower() for owner in owners)
    ]
    for module in modules[:1]:
        try:
            import_module(module)
        except Exception as error:  # whatever a broken package raises
            return (str(error).splitlines() or [type(error).__name__])[0][:100]
    return ""


def devices() -> dict[str, Any]:
    """What JAX computes on."""
    import jax

    return {"backend": jax.default_backend(), "devices": [str(one) for one in jax.devices()]}


def _gpu(feature: str) -> Finding:
    """Whether a GPU that is there is used."""
    import jax

    if jax.default_backend() == "gpu":
        return Finding(feature, FINE, {}, "")
    if shutil.which("nvidia-smi"):
        advice = f"JAX computes on the CPU; {install('cuda13')} for the GPU that is here"
        return Finding(feature, MISSING, {}, advice)
    return Finding(feature, MISSING, {}, "no NVIDIA GPU here; all works on CPUs")


def text(machine: dict[str, Any], findings: list[Finding]) -> str:
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
