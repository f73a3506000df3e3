"""Settings of a training: of each stage and level, and all of a run's together. Imports no JAX."""

from dataclasses import dataclass, field
from typing import Annotated

from lanewise.controllers.settings import GoalSettings, PlannerSettings, SearchSettings
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.fields.ranges import Between, OneOf
from lanewise.learning.settings import ExplorationSettings, LearnerSettings
from lanewise.scenario.settings import TrapSettings


@dataclass(frozen=True)
class BudgetSettings:
    """How long a stage drives, and which weights it keeps."""

    episodes: Annotated[int, Between(0, 10_000_000)] = 0
    """Stop when this many episodes are complete; 0 for no such limit."""
    decisions: Annotated[int, Between(0, 2_000_000_000)] = 120_000
    """Stop when this many decisions are taken over all worlds; 0 for no such limit."""
    duration: Annotated[int, Between(1, 100_000)] = 250
    """Training episodes are truncated after this many decisions."""
    worlds: Annotated[int, Between(1, 65_536)] = 32
    """Worlds driven at once."""
    keep: Annotated[str, OneOf(("best-training", "best-validation", "last"))] = "best-validation"
    """Which weights the stage keeps: best mean reward over 10 training episodes (the paper's
    rule for step 1), the median of the best five validations in a row, or the last."""


@dataclass(frozen=True)
class LevelSettings:
    """How one level learns: its rewards, its exploration and its learner."""

    updates_per_step: Annotated[float, Between(0.001, 16.0)] = 0.125
    """Learner updates per environment step (decision), over all worlds together (row 17)."""
    discount_across_goal: Annotated[str, OneOf(("per-goal", "per-decision"))] = "per-goal"
    """Row 14: gamma once per choice with the rewards inside it summed, or gamma^k after k decisions
    with the rewards inside it discounted. A choice of the high level lasts as long as its goal."""
    returns: Annotated[int, Between(1, 64)] = 1
    """n of n-step returns: choices whose rewards are summed before the value of the state after
    them."""
    time_out: Annotated[str, OneOf(("truncation", "terminal"))] = "truncation"
    """Row 18: bootstrap through a time-out, or treat it as terminal."""
    external_weight: Annotated[float, Between(0.0, 1000.0)] = 1.0
    """Weight of the external reward, accidents included; 0 for a level whose rewards come from its
    goals alone."""
    tracking_weight: Annotated[float, Between(0.0, 1000.0)] = 0.0
    """Row 21: weight w of the goal-tracking term -w (|dd|/4 m + |dv|/2 m/s), meant for the low
    level; 0 is the paper's external reward only."""
    approach_weight: Annotated[float, Between(0.0, 1000.0)] = 0.0
    """Weight of the approach to the goal: its distance, as in the tracking term, before a decision
    minus after it. A distant goal costs nothing, so avoiding such goals brings no reward."""
    goal_reward: Annotated[float, Between(0.0, 1000.0)] = 0.0
    """Reward for the decision that reaches the goal (h-DQN), meant for the low level."""
    goal_end: Annotated[str, OneOf(("bootstrap", "terminal"))] = "bootstrap"
    """What reaching its goal means to the level below: a step like any other, or an end (h-DQN)."""
    exploration: ExplorationSettings = field(default_factory=ExplorationSettings)
    """Exploration."""
    learner: LearnerSettings = field(default_factory=LearnerSettings)
    """Learner."""


@dataclass(frozen=True)
class StageSettings(LevelSettings, BudgetSettings):
    """A stage in which one level learns."""


@dataclass(frozen=True)
class SingleLevelSettings(StageSettings):
    """Training of the single-level controller, and how long it holds a choice."""

    hold: Annotated[int, Between(1, 100)] = 1
    """Decisions for which each choice is held, in training and in tests."""


@dataclass(frozen=True)
class HDQNSettings(BudgetSettings):
    """h-DQN (Kulkarni et al. 2016): both levels learn together, each with its own epsilon."""

    high_level: LevelSettings = field(default_factory=LevelSettings)
    """The high level, which learns from the external reward."""
    low_level: LevelSettings = field(default_factory=LevelSettings)
    """The low level, which is rewarded for reaching its goals."""


@dataclass(frozen=True)
class Settings:
    """Every setting of a run."""

    scenario: TrapSettings = field(default_factory=TrapSettings)
    """Who stands where at the start, and who drives how."""
    driving: DrivingSettings = field(default_factory=DrivingSettings)
    """The decision process around the ego."""
    goals: GoalSettings = field(default_factory=GoalSettings)
    """What the high level may ask for."""
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    """The rule-based planner of step 1."""
    search: SearchSettings = field(default_factory=SearchSettings)
    """The search over the nine actions, a reference."""
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    """How controllers are tested, and how weights are chosen."""
    single_level: SingleLevelSettings = field(
        default_factory=lambda: SingleLevelSettings(
            decisions=360_000, learner=LearnerSettings(learning_rate_decay=45_000)
        )
    )
    """Training of the single-level controller, with the budget of both steps together."""
    high_level: StageSettings = field(
        default_factory=lambda: StageSettings(learner=LearnerSettings(learning_rate_decay=15_000))
    )
    """Step 1: training of the high level above the planner."""
    low_level: StageSettings = field(
        default_factory=lambda: StageSettings(
            decisions=240_000,
            duration=60,
            tracking_weight=1.0,
            learner=LearnerSettings(learning_rate_decay=30_000),
        )
    )
    """Step 2: training of the low level below the frozen high level."""
    h_dqn: HDQNSettings = field(
        default_factory=lambda: HDQNSettings(
            decisions=360_000,
            high_level=LevelSettings(learner=LearnerSettings(learning_rate_decay=45_000)),
            low_level=LevelSettings(
                external_weight=0.0,
                goal_reward=1.0,
                goal_end="terminal",
                learner=LearnerSettings(discount=0.95, learning_rate_decay=45_000),
            ),
        )
    )
    """h-DQN: both levels together, with the budget of both steps."""
