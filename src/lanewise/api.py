"""What ``import lanewise`` offers: train with functions of your own, test anyone's policy."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from lanewise import interop
from lanewise.config.settings import Settings
from lanewise.controllers.registry import TRAINABLE
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions, checked
from lanewise.envs import functional, keywords
from lanewise.envs.control import GoalControl
from lanewise.errors import LanewiseError, RunError, brief
from lanewise.evaluation import external_policy, metrics, stepwise
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.metrics import Summary
from lanewise.evaluation.settings import WORLDS, EvaluationSettings
from lanewise.evaluation.stepwise import Lanewise, Simulator
from lanewise.experiments import evaluate_trained, published
from lanewise.export import exported
from lanewise.fields.ranges import EPISODES, SEEDS, FieldType
from lanewise.fields.suggestions import look_up
from lanewise.report import evaluation_table, output_files
from lanewise.runs import metric_sinks, training_loop
from lanewise.runs.run_folder import RunFolder, open_high_level
from lanewise.runs.trained import Trained
from lanewise.system import process
from lanewise.system.progress import Progress
from lanewise.training.plan import TrainingPlan

__all__ = ["Evaluation", "TaskFunctions", "evaluate", "train"]

SECTIONS = tuple(part.name for part in fields(Settings))
SEED, COUNT = FieldType(int, None, SEEDS), FieldType(int, None, EPISODES)
PATH, SWITCH, TEXT = FieldType(Path), FieldType(bool), FieldType(str)


@dataclass(frozen=True)
class Evaluation:
    """A policy's test: its outcomes, the metrics, and its episodes to look at."""

    episodes: Episodes
    """Outcomes, in the order of the starts."""
    summary: Summary
    """The metrics, with 95 % intervals."""
    _record: Any

    def __str__(self) -> str:
        """The table of ``lanewise evaluate``, beside the paper's figures if the test is its own."""
        return evaluation_table.text([self.summary]).rstrip("\n")

    def table(self, *others: "Evaluation") -> str:
        """This and others side by side, as Markdown."""
        return evaluation_table.markdown([self.summary, *(other.summary for other in others)])

    def record(self, episode: int = 0) -> Recording:
        """An episode frame by frame, driven once more."""
        process.refuse_forked()
        found: Recording = self._record(episode)
        return found

    def clip(self, path: Path | str, episode: int = 0) -> None:
        """Draw an episode from above into a .gif or .mp4.

        Raises:
            LanewiseError: the file cannot be written or belongs to a run, or a package is missing.
        """
        from lanewise.report import clip

        place = PATH.check("path", path)
        clip.check_name(place)
        output_files.check_writable(place)
        clip.render(self.record(episode), place)

    def save(self, path: Path | str) -> None:
        """Write the metrics as JSON and, beside it, the episodes as CSV.

        Args:
            path: of the JSON; the CSV's ends in ``.csv`` instead.

        Raises:
            LanewiseError: a file cannot be written, or belongs to a run, or ``path`` is the CSV's.
        """
        place = PATH.check("path", path)
        if place.suffix.lower() == ".csv":
            raise LanewiseError(
                f"cannot write {place}: the episodes go there; let the metrics' name end in .json"
            )
        output_files.check_writable(place)
        beside = place.with_suffix(".csv")
        output_files.check_writable(beside)
        output_files.write_text(place, json.dumps(self.summary.to_json(), indent=2) + "\n")
        output_files.write_text(beside, metrics.to_csv(self.episodes))


def train(
    out: Path | str,
    controller: str = "hierarchical",
    *,
    seed: int | None = None,
    preset: str | None = None,
    trap: str | None = None,
    task: TaskFunctions = PAPER_TASK,
    high_level_of: Path | str | None = None,
    resume: bool = False,
    tensorboard: bool = False,
    quiet: bool = False,
    **settings: Any,
) -> Path:
    """Train a controller into a run folder, as ``lanewise train`` does.

    Args:
        out: the run folder: new or empty, or a stopped run together with ``resume``.
        controller: ``hierarchical``, ``single-level``, ``planned`` or ``h-dqn``; with ``resume``
            that of the run.
        seed: of everything random; 0 by default.
        preset: a training preset; ``quick`` by default.
        trap: a scenario preset; ``trap-10`` by default.
        task: your own functions for start, observation, reward and success. The run stores their
            names; ``resume`` needs the same functions, `evaluate` an observation that fits.
        high_level_of: a run whose finished step 1 is taken over; only step 2 is then trained.
        resume: continue the run in the folder, to the same bits as if it had never stopped, with
            its own settings and seed.
        tensorboard: also write TensorBoard's events.
        quiet: show no progress, only warnings.
        settings: any setting, named as for `lanewise.envs.functional.make`. Those of a TOML file
            are ``**tomllib.loads(text)``.

    Returns:
        The run folder, for `evaluate`.

    Raises:
        LanewiseError: an argument is wrong, or the folder holds another run or anything else.
        KeyboardInterrupt: Ctrl-C or SIGTERM; raised once the chunk under way is saved, or at once
            the second time. A note on the exception says how to continue.
    """
    process.refuse_forked()
    path: Path = PATH.check("out", out)
    look_up("controller", controller, dict.fromkeys(TRAINABLE))
    seed = None if seed is None else SEED.check("seed", keywords.plain(seed))
    task = checked(task)
    for name, value in {"resume": resume, "tensorboard": tensorboard, "quiet": quiet}.items():
        SWITCH.check(name, value)
    if tensorboard:
        metric_sinks.tensorboard_writer()
    lender = None if high_level_of is None else PATH.check("high_level_of", high_level_of)
    presets = ("quick" if preset is None else preset, "trap-10" if trap is None else trap)
    composed = keywords.compose(*presets, settings, SECTIONS)
    with _file_errors("write", path):
        if resume:
            given = preset is not None or trap is not None or settings
            folder = RunFolder.resume(path, composed if given else None, controller, seed)
            plan = TrainingPlan.build(folder.settings, controller, task)
        else:
            # Before the folder is made: a refused run leaves nothing behind.
            if lender is not None:
                open_high_level(lender, controller, composed, task.names())
            plan = TrainingPlan.build(composed, controller, task)
            observed = plan.trace()
            folder = RunFolder.create(
                path, composed, controller, 0 if seed is None else seed, task.names(), observed
            )
        with folder, Progress(quiet=quiet) as reporter:
            try:
                training_loop.train(
                    folder, plan, reporter, high_level=lender, tensorboard=tensorboard
                )
            except KeyboardInterrupt as stop:
                # Said at once, as the caller may catch it, and once more below a traceback.
                how = f"training stopped; continue with: {_again(folder, lender, task)}"
                reporter.note(how)
                stop.add_note(how)
                raise
    return path


@contextmanager
def _file_errors(verb: str, path: Path) -> Iterator[None]:
    """Turn the system's errors with files into Lanewise's, as the command line does."""
    try:
        yield
    except OSError as error:
        place = brief(str(error.filename or path))
        raise RunError(f"cannot {verb} {place}: {error.strerror or error}") from error


def _again(folder: RunFolder, lender: Path | None, task: TaskFunctions) -> str:
    """The call that continues a training."""
    words = [repr(str(folder.path))]
    if folder.controller != "hierarchical":
        words.append(repr(folder.controller))
    if task.names():
        words.append("task=...")
    if lender is not None and not folder.stages.exists():
        words.append(f"high_level_of={str(lender)!r}")  # not taken over yet
    return f"lanewise.train({', '.join([*words, 'resume=True'])})"


def evaluate(
    policy: Any,
    *,
    name: str | None = None,
    actions: str | None = None,
    world: str = "lanewise",
    episodes: int = 300,
    seed: int = 0,
    batched: bool | None = None,
    deterministic: bool = True,
    quiet: bool = False,
    **settings: Any,
) -> Evaluation:
    """Test a policy as the paper tests its controllers: greedy episodes from the test start.

    Nothing is loaded that could hold code. Load an agent of another library yourself.

    Args:
        policy: a function from observations (float32 [26], or a batch [B, 26]) to actions, without
            memory; an object with ``predict`` as Stable-Baselines3's agents, which may have one;
            or a run folder, a checkpoint in one, a file of ``lanewise export``,
            ``pretrained/NAME``, ``reference/NAME``.
        name: in the table; ``policy`` by default. Trained controllers have their own.
        actions: what your policy chooses: ``low-level`` actions (the default), ``goal`` (used
            where the goal critic asks for a new one) or ``continuous`` acceleration and steering.
        world: ``lanewise``, or ``highway-env`` for the real one.
        episodes: number of test episodes, at most 10,000,000.
        seed: of the starts.
        batched: whether a function takes batches; None tries it. For functions only.
        deterministic: ask ``predict`` for its deterministic action, and refuse a function that
            answers the same observation differently; False for a random policy.
        quiet: show no progress.
        settings: as of `lanewise.envs.functional.make`, such as ``duration``, ``task`` and any
            setting of scenario and driving. Of a trained controller ``duration``, the scenario
            and ``task`` may be others than in its training, as long as its networks fit the
            observation. A line on standard error says what differs.

    Returns:
        Metrics, outcomes, and episodes to look at.

    Raises:
        LanewiseError: an argument is wrong, or the policy chose an action that does not exist.
    """
    process.refuse_forked()
    look_up("world", world, dict.fromkeys(WORLDS))
    episodes = COUNT.check("episodes", keywords.plain(episodes))
    seed = SEED.check("seed", keywords.plain(seed))
    for option, switch in {"quiet": quiet, "deterministic": deterministic}.items():
        SWITCH.check(option, switch)
    if isinstance(policy, str | Path | Trained):
        at_random = None if deterministic else True
        options = {"name": name, "actions": actions, "batched": batched, "deterministic": at_random}
        for option, value in options.items():
            if value is not None:
                raise LanewiseError(f"{option}: a controller of ours brings its own; leave it out")
        return _ours(policy, world, episodes, seed, quiet, settings)
    name = "policy" if name is None else TEXT.check("name", name)
    if batched is not None:
        SWITCH.check("batched", batched)
    config, choices = _course("low-level" if actions is None else actions, settings)
    decide = external_policy.decider(policy, batched, choices, deterministic)
    chooser = stepwise.external(decide)
    simulator: Simulator = Lanewise()
    if world == "highway-env":
        simulator = interop.evaluation_in_highway_env().HighwayEnv()
    with Progress(quiet=quiet) as reporter:
        reporter.stage(name, episodes)
        found = stepwise.evaluate(config, chooser, simulator, seed, episodes, reporter.update)
    return Evaluation(
        episodes=found,
        summary=_summary(found, name, world, config),
        _record=lambda index: replace(
            stepwise.record(config, chooser, simulator, seed, index), controller=name
        ),
    )


def _ours(
    policy: str | Path | Trained, world: str, episodes: int, seed: int, quiet: bool, settings: Any
) -> Evaluation:
    """The test of a trained controller."""
    task = checked(settings.pop("task")) if "task" in settings else PAPER_TASK
    if "duration" in settings:
        settings["evaluation.duration"] = settings.pop("duration")
    changes = keywords.in_full(settings, SECTIONS)
    if isinstance(policy, Trained):
        controller = replace(policy, task=task) if task != PAPER_TASK else policy
    else:
        path = PATH.check("policy", policy)
        with _file_errors("read", path):
            controller = exported.load(path, task)
    with Progress(quiet=quiet) as reporter:
        controller = evaluate_trained.with_changes(controller, changes, reporter.note)
        config = evaluate_trained.evaluation_config(controller)
        found = evaluate_trained.evaluate(controller, world, episodes, seed, reporter)
    return Evaluation(
        episodes=found,
        summary=_summary(found, controller.name, world, config),
        _record=partial(evaluate_trained.record, controller, world, seed),
    )


def _summary(found: Episodes, name: str, world: str, config: EvaluationConfig) -> Summary:
    """The metrics of a test, and what makes it unlike the paper's."""
    seconds: Any = config.duration / config.driving.decision_frequency
    settings = replace(
        Settings(),
        scenario=config.scenario,
        driving=config.driving,
        evaluation=EvaluationSettings(duration=seconds),
    )
    unlike = published.unlike_test(settings, config.task.names(), config.split)
    return metrics.summarise(found, controller=name, world=world, unlike_paper=unlike)


def _course(actions: str, settings: dict[str, Any]) -> tuple[EvaluationConfig, int]:
    """(the test with these settings and the controller that takes the choices, their number).

    The number is 0 for continuous actions. The policy's name is left out: the test is static, and
    another name would be compiled anew.
    """
    given: dict[str, Any] = {"split": "test"} | settings
    task = functional.make(actions, **given)
    controller: Any = SingleLevel()
    if isinstance(task.control, GoalControl):
        controller = task.control.planned(task.driving)
    config = EvaluationConfig(
        task.scenario, task.driving, controller, task.duration, task.split, task=task.task
    )
    return config, task.control.count
