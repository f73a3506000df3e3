"""``lanewise reproduce``: trains, tests and reports the paper's experiment in one go."""

import os
import shlex
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any, TextIO, cast

from lanewise import config
from lanewise.commands.arguments import Parsed
from lanewise.commands.train import SEEDS
from lanewise.config import PRESETS, TRAPS, Settings
from lanewise.errors import LanewiseError, RunError
from lanewise.progress import Progress
from lanewise.ranges import Between, OneOf
from lanewise.runs.folder import CONTROLLERS, RunFolder, require_empty

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"
"""Each arm computes on one core, so that two arms do not fight for two."""


@dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Train both controllers, test them, and print the paper's table with ours beside it.

    The same command in the same folder continues what was interrupted.
    """

    out: Path
    """Folder for the runs and the report: new or empty, or one this command was stopped in."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of everything random."""
    episodes: Annotated[int, Between(1, 10_000_000)] = 300
    """Test episodes in our world."""
    highway_env_episodes: Annotated[int, Between(1, 10_000_000)] = 100
    """Test episodes in the real highway-env, the first of the same starts."""
    preset: Annotated[str, OneOf(tuple(PRESETS))] = "quick"
    """Training preset."""
    trap: Annotated[str, OneOf(tuple(TRAPS))] = "trap-10"
    """Scenario preset."""
    settings: Path | None = None
    """TOML file with any of the settings below."""
    values: Settings = field(default_factory=Settings, metadata={"inline": True})
    """Every setting."""


@dataclass(frozen=True)
class Arm:
    """One controller's part of the work, done in a process of its own."""

    controller: str
    path: Path
    settings: Settings
    seed: int
    episodes: int
    highway_env_episodes: int


@dataclass(frozen=True)
class Result:
    """What an arm brings back."""

    ours: Any
    """`Episodes` in our world."""
    theirs: Any
    """`Episodes` in highway-env."""
    recording: Any
    """`Recording` of test episode 0 in our world."""
    curves: list[dict[str, Any]]
    """Metrics lines of the training's chunks."""
    times: dict[str, float]
    """Seconds by part."""


def run(parsed: Parsed[Reproduce]) -> int:
    """Trains, tests and reports; returns the exit code."""
    command = parsed.command
    from lanewise.report import extras

    extras.check()
    if find_spec("highway_env") is None:
        raise LanewiseError('reproduce needs highway-env: pip install "lanewise[report,highway]"')
    arms = [
        Arm(
            controller,
            command.out / controller,
            command.values,
            command.seed,
            command.episodes,
            command.highway_env_episodes,
        )
        for controller in CONTROLLERS
    ]
    _check_folder(command.out, arms)
    command.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    try:
        with _one_thread_each(), ProcessPoolExecutor(len(arms), get_context("spawn")) as pool:
            results = list(pool.map(drive_arm, arms))
    except BrokenProcessPool:
        raise RunError(
            "a training was killed, perhaps for want of memory; the same command continues it"
        ) from None
    _report(command, dict(zip(CONTROLLERS, results, strict=True)), time.monotonic() - began)
    return 0


def drive_arm(arm: Arm) -> Result:
    """Train a controller, or continue, then test it in both worlds."""
    from lanewise.commands import testing
    from lanewise.runs import metrics, trained
    from lanewise.runs.train import train

    times = {}
    with Progress(stream=cast(TextIO, _Prefixed(sys.stderr, f"[{arm.controller}] "))) as reporter:
        with _folder(arm) as folder:
            if not trained.is_finished(folder):
                began = time.monotonic()
                train(folder, None, reporter)
                times[f"train {arm.controller}"] = time.monotonic() - began
        controller = trained.load(arm.path)
        began = time.monotonic()
        ours = testing.test(controller, "lanewise", arm.episodes, arm.seed, reporter)
        times[f"test {arm.controller} in lanewise"] = time.monotonic() - began
        began = time.monotonic()
        theirs = testing.test(
            controller, "highway-env", arm.highway_env_episodes, arm.seed, reporter
        )
        times[f"test {arm.controller} in highway-env"] = time.monotonic() - began
        recording = testing.record(controller, "lanewise", arm.seed, 0)
    lines = [line for line in metrics.read(folder.metrics) if line["kind"] == "chunk"]
    return Result(ours, theirs, recording, lines, times)


def _folder(arm: Arm) -> RunFolder:
    if (arm.path / "run.json").exists():
        return RunFolder.resume(arm.path, arm.settings, arm.controller, arm.seed)
    return RunFolder.create(arm.path, arm.settings, arm.controller, arm.seed)


def _check_folder(out: Path, arms: list[Arm]) -> None:
    """Refuse a folder of something else, or of other settings, before any work.

    Raises:
        RunError: says which.
    """
    if not any((arm.path / "run.json").exists() for arm in arms):
        require_empty(out)
        return
    if (out / "report.md").exists():
        raise RunError(f"{out} is complete: see {out / 'report.md'}, or choose another folder")
    for arm in arms:
        if (arm.path / "run.json").exists():
            _folder(arm).close()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """While children start: their XLA computes on one thread."""
    before = os.environ.get("XLA_FLAGS")
    os.environ["XLA_FLAGS"] = f"{before or ''} {ONE_THREAD}".strip()
    try:
        yield
    finally:
        if before is None:
            del os.environ["XLA_FLAGS"]
        else:
            os.environ["XLA_FLAGS"] = before


class _Prefixed:
    """A text stream that writes each line with a prefix; two arms share one standard error."""

    def __init__(self, stream: TextIO, prefix: str) -> None:
        self._stream = stream
        self._prefix = prefix

    def write(self, text: str) -> int:
        """Write whole lines at once, so that two processes do not mix theirs."""
        return self._stream.write("".join(f"{self._prefix}{line}\n" for line in text.splitlines()))

    def flush(self) -> None:
        """Pass it on."""
        self._stream.flush()

    def isatty(self) -> bool:
        """Never: two bars would fight for one terminal."""
        return False


def _report(command: Reproduce, results: dict[str, Result], seconds: float) -> None:
    """Write the report and print its table."""
    from lanewise.evaluation import metrics
    from lanewise.report import report, table

    summaries = []
    for controller, result in results.items():
        for world, episodes in (("lanewise", result.ours), ("highway-env", result.theirs)):
            summaries.append(metrics.summarise(episodes, controller=controller, world=world))
    times = {name: value for result in results.values() for name, value in result.times.items()}
    curves = [line for result in results.values() for line in result.curves]
    path = report.write_report(
        command.out,
        report.Report(
            title="The trap: single-level against hierarchical",
            command=shlex.join(["lanewise", *sys.argv[1:]]),
            summaries=summaries,
            settings=config.flatten(command.values) | {"seed": command.seed},
            curves=curves,
            recording=results["hierarchical"].recording,
            paired={name: metrics.paired(r.ours, r.theirs) for name, r in results.items()},
            times=times | {"everything": seconds},
        ),
    )
    sys.stdout.write(table.text(summaries))
    for name, result in results.items():
        pairs = metrics.paired(result.ours, result.theirs)
        sys.stdout.write(
            f"{name}: {pairs.share:.1%} of {pairs.episodes} starts end alike in both worlds\n"
        )
    sys.stdout.write(f"\nreport: {path}\n")
