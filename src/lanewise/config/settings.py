"""The presets that change the settings of a run. Imports no JAX."""

from collections.abc import Mapping

from lanewise.training.settings import Settings as Settings

ONE_LEVEL_STAGES = ("single_level", "high_level", "low_level")
"""Stages in which one level learns."""
_PAPER_BUDGET: dict[str, object] = {"decisions": 0, "duration": 250, "worlds": 1}
_PAPER_LEVEL: dict[str, object] = {
    "updates_per_step": 1.0,
    "exploration.start": 0.5,
    "exploration.end": 0.02,
    "exploration.steps": 1000,
    "learner.learning_rate_decay": 0,
    # With the default of 1000 steps exploration would be over before anything is learnt.
    "learner.warm_up": 64,
}
_PAPER_METHOD: dict[str, object] = {
    "driving.observation.scaling": "highway-env",
    "goals.time_limit": 1000.0,
    "low_level.tracking_weight": 0.0,
    "h_dqn.low_level.learner.discount": 0.8,
    # A chunk of one world is short: this is every 5,000 decisions.
    "evaluation.validation_interval": 100,
}


def _under(names: tuple[str, ...], values: Mapping[str, object]) -> dict[str, object]:
    return {f"{name}.{leaf}": value for name in names for leaf, value in values.items()}


_DRIVER_STARTS: dict[str, object] = {
    "scenario.training_ego_speed": (7.5, 13.5),
    "scenario.training_trap_speed": (7.5, 11.5),
    "scenario.training_lanes": (2, 5),
    "scenario.training_front_distance": (13.5, 22.0),
    "scenario.training_side_distance": (-2.0, 12.0),
    "scenario.training_braking": 0.8,
    "scenario.training_trap_speed_difference": (0.0, 1.0),
    "scenario.training_traffic_speed": (10.5, 15.0),
    "scenario.training_spacing": (15.0, 40.0),
    "scenario.training_vehicles_ahead": (0, 12),
    "scenario.training_vehicles_behind": (0, 4),
    "scenario.training_gap_behind": (35.0, 80.0),
    # Held out, for tests: highd, aggressive, defensive and stop-and-go.
    "scenario.training_populations": ("paper", "highway-env", "impolite", "timid", "cutting-in"),
    "driving.observation.variant": "lanes",
    "driving.reward.accident_penalty": 30.0,
    "evaluation.duration": 60,
    "evaluation.validation_episodes": 400,
    "evaluation.validation_interval": 40,
}
# While the step size falls to nearly nothing, validations get better to the end, and the median of
# five in a row lags behind: the last weights did better on fresh starts (docs/driver.md).
_WIDE_BUDGET: dict[str, object] = {"worlds": 64, "keep": "last"}
# Less noise in each update: half as many for every decision, each over twice as many transitions.
_WIDE_LEVEL: dict[str, object] = {
    "updates_per_step": 0.0625,
    "learner.discount": 0.9,
    "learner.final_learning_rate": 0.00001,
    "learner.batch_size": 128,
    "learner.replay_capacity": 200_000,
    "learner.hidden": (256, 256),
}

PRESETS: dict[str, dict[str, object]] = {
    "quick": {},
    "paper": _under((*ONE_LEVEL_STAGES, "h_dqn"), _PAPER_BUDGET)
    | _under((*ONE_LEVEL_STAGES, "h_dqn.high_level", "h_dqn.low_level"), _PAPER_LEVEL)
    | _PAPER_METHOD
    | _under(("single_level", "low_level", "h_dqn"), {"episodes": 2000, "keep": "last"})
    | _under(("high_level",), {"episodes": 1000, "keep": "best-training"}),
    "driver": _DRIVER_STARTS
    | _under((*ONE_LEVEL_STAGES, "h_dqn"), _WIDE_BUDGET)
    | _under((*ONE_LEVEL_STAGES, "h_dqn.high_level", "h_dqn.low_level"), _WIDE_LEVEL)
    | {
        "high_level.decisions": 1_600_000,
        "high_level.duration": 120,
        "high_level.exploration.steps": 100_000,
        "high_level.learner.learning_rate_decay": 100_000,
        "low_level.decisions": 2_400_000,
        "low_level.duration": 120,
        "low_level.exploration.steps": 60_000,
        "low_level.learner.learning_rate_decay": 150_000,
        "low_level.tracking_weight": 0.0,
        "low_level.approach_weight": 3.0,
        "low_level.learner.discount": 0.95,
    }
    | _under(("single_level", "h_dqn"), {"decisions": 4_000_000, "duration": 120})
    | _under(
        ("single_level", "h_dqn.high_level", "h_dqn.low_level"),
        {"exploration.steps": 100_000, "learner.learning_rate_decay": 250_000},
    ),
}
"""Training presets: what each changes in the defaults.

``quick`` and ``paper`` train on the paper's ranges of D1 and D2; ``driver`` over all that varies at
a start, on relative features alone (docs/driver.md). ``paper`` is what the paper states, in one
world, with highway-env's own scaling. Of what ``quick`` adds to the method it has only rows 22b
and 30.
"""

TRAPS: dict[str, dict[str, object]] = {
    "trap-10": {},
    "trap-10.9": {"scenario.trap_speed": 10.9},
}
"""Scenario presets: what each changes in the defaults."""


OF_TEST = ("evaluation.duration", "driving.latency", "driving.observation.noise")
"""Settings of a test outside its scenario and its reward."""


def of_test(name: str) -> bool:
    """Whether a test of a controller may have another value of a setting than its training.

    Scenario, reward and length are; all else is part of the controller, or speaks of training
    starts.
    """
    if name.startswith(("scenario.training_", "scenario.ego_driver")):
        return False
    return name.startswith(("scenario.", "driving.reward.")) or name in OF_TEST
