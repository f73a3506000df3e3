"""Settings of training stages. Imports no JAX."""

from dataclasses import dataclass, field
from typing import Annotated

from lanewise.learning.settings import ExplorationSettings, LearnerSettings
from lanewise.ranges import Between, OneOf


@dataclass(frozen=True)
class StageSettings:
    """One stage of a training recipe: its budget and how its learner learns."""

    episodes: Annotated[int, Between(0, 10_000_000)] = 0
    """Stop when this many episodes are complete; 0 for no such limit."""
    decisions: Annotated[int, Between(0, 2_000_000_000)] = 120_000
    """Stop when this many decisions are taken over all worlds; 0 for no such limit."""
    duration: Annotated[int, Between(1, 100_000)] = 250
    """Training episodes are truncated after this many decisions."""
    worlds: Annotated[int, Between(1, 65_536)] = 32
    """Worlds driven at once."""
    updates_per_step: Annotated[float, Between(0.001, 16.0)] = 0.125
    """Learner updates per environment step (decision), over all worlds together (row 17)."""
    keep: Annotated[str, OneOf(("best-training", "best-validation", "last"))] = "best-validation"
    """Which weights the stage hands on: best mean reward over 10 training episodes (the paper's
    rule for step 1), best on validation starts, or the last."""
    discount_across_goal: Annotated[str, OneOf(("per-goal", "per-decision"))] = "per-goal"
    """Row 14: gamma once per goal with the rewards inside it summed, or gamma^k after k decisions
    with the rewards inside it discounted."""
    time_out: Annotated[str, OneOf(("truncation", "terminal"))] = "truncation"
    """Row 18: bootstrap through a time-out, or treat it as terminal."""
    tracking_weight: Annotated[float, Between(0.0, 1000.0)] = 0.0
    """Row 21: weight w of the goal-tracking term -w (|dd|/4 m + |dv|/2 m/s) of the low level;
    0 is the paper's external reward only."""
    exploration: ExplorationSettings = field(default_factory=ExplorationSettings)
    """Exploration."""
    learner: LearnerSettings = field(default_factory=LearnerSettings)
    """Learner."""
