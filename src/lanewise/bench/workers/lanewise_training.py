"""Our training of the single-level controller with as many updates as environment steps."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax

from lanewise import config
from lanewise.training import host, recipe, stage
from lanewise.training.host import StagePlan, StageProgress

WARM_UP = 1_000
"""Environment steps before the first update."""
NEVER = 1_000_000_000


def prepare(worlds: int, seconds: float, seed: int) -> Callable[[], dict[str, Any]]:
    """Compiles and trains past the warm-up; the result trains for ``seconds``.

    The breakdown comes from the same loop run again without updates: what it takes then is
    driving, replay writing included, and the rest of the loop's time is the updates'.
    """
    learning, driving = plan(worlds, WARM_UP), plan(worlds, NEVER)
    began = time.perf_counter()
    progress = begun(learning, seed)
    compiling = time.perf_counter() - began
    idle = begun(driving, seed)

    def measure() -> dict[str, Any]:
        train = timed(learning, progress, seconds)
        drive = timed(driving, idle, seconds / 4)
        steps = train["steps"]
        driven = drive["loop"] / drive["steps"] * steps
        return {
            "steps": steps,
            "updates": train["updates"],
            "seconds": train["seconds"],
            "breakdown": {
                "driving": driven,
                "updates": train["loop"] - driven,
                "host": train["seconds"] - train["loop"],
            },
            "compile_seconds": compiling,
        }

    return measure


def plan(worlds: int, warm_up: int) -> StagePlan:
    """The stage without end and without validation, its first update after ``warm_up`` steps."""
    settings = config.compose()
    (single_level,) = recipe.RECIPES["single-level"]
    found = recipe.course(settings, single_level)
    how = found.learning[0][1]
    how = replace(how, updates_per_step=1.0, learner=replace(how.learner, warm_up=warm_up))
    return StagePlan(
        name="single-level",
        course=replace(
            found,
            budget=replace(found.budget, worlds=worlds, decisions=2_000_000_000, keep="last"),
            learning=((found.learning[0][0], how),),
        ),
        validation=recipe.validation_course(settings, single_level),
        validation_episodes=0,
        validation_interval=1_000_000,
        fresh_episodes=0,
    )


def begun(plan: StagePlan, seed: int) -> StageProgress:
    """The stage past its warm-up."""
    progress = host.begin(plan, {}, jax.random.key(seed))
    while progress.ledger.decisions <= WARM_UP:
        progress, _ = host.advance(plan, {}, progress)
    return progress


def timed(plan: StagePlan, progress: StageProgress, seconds: float) -> dict[str, Any]:
    """Train for so long: steps, updates, seconds of everything and of the compiled loop alone."""
    steps, loop = 0, 0.0
    first = int(progress.state.learners["single_level"].updates)
    began = time.perf_counter()
    while time.perf_counter() - began < seconds:
        asked = time.perf_counter()
        state, metrics = stage.advance(plan.course, {}, progress.state)
        metrics.finished.done.block_until_ready()
        loop += time.perf_counter() - asked
        progress, _ = host.book(plan, {}, progress, state, metrics)
        steps += stage.CHUNK * plan.course.budget.worlds
    return {
        "steps": steps,
        "updates": int(progress.state.learners["single_level"].updates) - first,
        "seconds": time.perf_counter() - began,
        "loop": loop,
    }
