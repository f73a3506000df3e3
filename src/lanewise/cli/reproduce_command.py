"""``lanewise reproduce``: trains, tests and reports the paper's experiments in one go."""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from lanewise import config
from lanewise.cli.command_line import Parsed
from lanewise.config import validation
from lanewise.config.settings import TRAPS, Settings
from lanewise.errors import LanewiseError, RunError, SettingsError, one_line, shell_line
from lanewise.experiments import experiment as experiments
from lanewise.experiments.experiment import BUILT_IN, Experiment
from lanewise.fields.ranges import EPISODES, SEEDS, Between, OneOf
from lanewise.system import extras, folder_io, process
from lanewise.system.progress import tell


@dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Run an experiment of the paper: train its arms, test them, report.

    The same command in the same folder continues what was interrupted and skips what is done.
    "Row N" is that of the table in docs/paper.md.
    """

    out: Path
    """Folder for the runs and the report: new or empty, or one of this experiment."""
    preset: Annotated[str, OneOf(BUILT_IN)] = "quick"
    """Which experiment: quick (two arms, one seed, minutes), standard (every arm, 5 to 20 seeds,
    hours), paper (what the paper states, at its size, five seeds, a night)."""
    experiment: Path | None = None
    """TOML file with an experiment of your own, instead of a preset."""
    only: tuple[str, ...] = ()
    """Arms to run, by name; all of them if not given."""
    seed: Annotated[int, SEEDS] = 0
    """First seed."""
    seeds: Annotated[int, Between(1, 1000)] | None = None
    """Number of seeds, instead of the experiment's."""
    episodes: Annotated[int, EPISODES] | None = None
    """Test episodes a seed in our world, instead of the experiment's."""
    highway_env_episodes: Annotated[int, Between(0, 10_000_000)] | None = None
    """Test episodes a seed in the real highway-env, the first of the same starts; 0 for none."""
    processes: Annotated[int, Between(1, 1024)] | None = None
    """Trainings at once; one for each core if not given."""
    trap: Annotated[str, OneOf(tuple(TRAPS))] = "trap-10"
    """Scenario preset."""
    settings: Path | None = None
    """TOML file with any of the settings below; like them, it wins over those of the arms."""
    values: Settings = field(default_factory=Settings)
    """Every setting."""


def run(parsed: Parsed[Reproduce]) -> int:
    """Trains, tests and reports; returns the exit code."""
    command = parsed.command
    _refuse(parsed)
    whole = _experiment(command)
    chosen = whole.only(command.only) if command.only else whole
    overrides = _overrides(parsed)
    for arm in whole.arms:
        settings = whole.settings(arm, command.trap, overrides)
        if arm.trained:
            validation.check_memory(settings, arm.controller, process.total_memory())
    extras.check()
    wanted = any(arm.highway_env_episodes for arm in chosen.arms)
    if wanted and find_spec("highway_env") is None:
        raise LanewiseError(f"reproduce needs highway-env: {extras.install('report', 'highway')}")
    experiments.check_folder(command.out, whole)
    from lanewise.experiments import jobs as job_list
    from lanewise.experiments import reporting, results, schedule

    place = (command.out, command.seed, command.trap, overrides)
    jobs = job_list.of_experiment(chosen, *place)
    every = job_list.of_experiment(whole, *place)
    for job in every:
        job_list.check(job)
    # Looks at every job: a test that is damaged or of another run is refused first.
    done = {job.path for job in every if job.done}
    report = command.out / "report.md"
    if report.exists() and all(job.path in done for job in jobs):
        raise RunError(f"{command.out} is complete: see {report}, or choose another folder")
    with folder_io.lock(command.out, "reproducing") as out:
        # Another process may have begun something else meanwhile.
        experiments.check_folder(command.out, whole)
        experiments.mark_folder(out, whole)
        # An old report would make an unfinished folder look complete.
        out.unlink(report.name)
        began = time.monotonic()
        processes = command.processes or len(process.usable_cores())
        times = schedule.run(jobs, processes, sys.stderr, out)
        out.require_same()
        tell("writing the report")
        path, text = reporting.write(
            out,
            whole,
            results.collect(whole, every),
            command=shell_line("lanewise", *sys.argv[1:]),
            times=times | {"everything": time.monotonic() - began},
        )
    sys.stdout.write(f"{text}\nreport: {one_line(path.with_suffix('.html'))}, {one_line(path)}\n")
    return 0


def _refuse(parsed: Parsed[Reproduce]) -> None:
    """Refuses options that contradict one another."""
    command = parsed.command
    if command.experiment is not None and "preset" in parsed.given:
        raise SettingsError("--experiment and --preset each name an experiment; give one of them")
    last = command.seed + (command.seeds or 1) - 1
    if not SEEDS.holds(last):
        raise SettingsError(f"--seed and --seeds lead to seed {last}; the last one must be {SEEDS}")


def _experiment(command: Reproduce) -> Experiment:
    """What is to be run, with the command's own numbers."""
    if command.experiment is None:
        found = experiments.load(command.preset)
    else:
        found = experiments.load_file(command.experiment)
    given = {
        name: getattr(command, name)
        for name in ("seeds", "episodes", "highway_env_episodes")
        if getattr(command, name) is not None
    }
    return replace(found, arms=tuple(replace(arm, **given) for arm in found.arms))


def _overrides(parsed: Parsed[Reproduce]) -> Mapping[str, object]:
    """The settings the user gave, in a file or as flags, by dotted name."""
    command = parsed.command
    values = config.flatten(command.values)
    flags = {name: values[name] for name in parsed.given if "." in name}
    return (config.load_toml(command.settings) if command.settings else {}) | flags
