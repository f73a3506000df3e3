"""Settings of the decision process: rates, actions, observation, reward, endings. No JAX."""

from dataclasses import dataclass, field
from math import ceil, pi
from typing import Annotated

from lanewise.driving import lane_observation
from lanewise.fields.ranges import Between, OneOf, OrNone

Weight = Between(0.0, 1000.0)
VARIANTS = {"kinematics": 26, "lanes": lane_observation.SIZE}
"""Observations, and how many features each has."""


@dataclass(frozen=True)
class ActionSettings:
    """The nine low-level actions: acceleration and steering, each one of minus, nothing, plus."""

    acceleration: Annotated[float, Between(0.01, 10.0, "m/s^2")] = 1.0
    """Size of the acceleration step."""
    steering: Annotated[float, Between(0.001, 1.0, "rad")] = pi / 50
    """Size of the steering step."""


@dataclass(frozen=True)
class ObservationSettings:
    """What a controller observes, and how it is scaled.

    ``kinematics`` are the paper's 26 features. Their scaling ``highway-env`` is its own: x by
    200 m, y by the width of the road, speeds by 80 m/s, clipped to [-1, 1]. ``fine`` divides by the
    ranges below and clips to [-2, 2]. ``lanes`` are 32 relative features, lane by lane, with fixed
    divisors; `lanewise.driving.lane_observation` lists them.
    """

    variant: Annotated[str, OneOf(tuple(VARIANTS))] = "kinematics"
    """Which features; the settings below speak of kinematics."""
    scaling: Annotated[str, OneOf(("fine", "highway-env"))] = "fine"
    """Name of the scaling."""
    x_range: Annotated[float, Between(1.0, 1000.0, "m")] = 60.0
    """Longitudinal distance that reads as 1 in the fine scaling."""
    speed_range: Annotated[float, Between(1.0, 100.0, "m/s")] = 15.0
    """The ego's speed that reads as 1 in the fine scaling."""
    relative_speed_range: Annotated[float, Between(0.5, 100.0, "m/s")] = 5.0
    """Relative speed that reads as 1 in the fine scaling."""
    perception_distance: Annotated[float, Between(1.0, 1000.0, "m")] = 200.0
    """Vehicles farther than this are not observed."""
    noise: Annotated[float, Between(0.0, 10.0)] = 0.0
    """Standard deviation of the normal error of every feature, as scaled, in every decision."""
    training_noise: Annotated[tuple[float, ...], Between(0.0, 10.0), OrNone(2)] = ()
    """The same in training and validation: uniform between the two for each decision; empty: as in
    tests."""

    def noise_range(self, training: bool) -> tuple[float, float]:
        """Smallest and largest noise."""
        low, high = (training and self.training_noise) or (self.noise, self.noise)
        return low, high

    @property
    def size(self) -> int:
        """Number of features."""
        return VARIANTS[self.variant]

    @property
    def limit(self) -> float:
        """Features are clipped to plus and minus this."""
        if self.variant == "lanes":
            return lane_observation.LIMIT
        return 2.0 if self.scaling == "fine" else 1.0


@dataclass(frozen=True)
class RewardSettings:
    """Weights of the reward (eq. 3-6 of the paper) and the penalty that replaces it."""

    speed_weight: Annotated[float, Weight] = 1.5
    """Weight w_v of the speed term."""
    steering_weight: Annotated[float, Weight] = 0.05
    """Weight w_theta of the steering term."""
    centring_weight: Annotated[float, Weight] = 0.05
    """Weight w_y of the lane-centring term."""
    accident_penalty: Annotated[float, Between(0.0, 1e6)] = 10.0
    """Subtracted instead of any reward when an accident happens."""


@dataclass(frozen=True)
class DrivingSettings:
    """The decision process around the ego."""

    simulation_frequency: Annotated[int, Between(1, 100, "Hz")] = 10
    """Ticks a second."""
    decision_frequency: Annotated[int, Between(1, 50, "Hz")] = 2
    """Low-level decisions a second. A decision lasts floor(simulation/decision) ticks, so there
    may be more."""
    latency: Annotated[float, Between(0.0, 10.0, "s")] = 0.0
    """Time from a decision until it takes effect, to the nearest tick; less than a decision."""
    training_latency: Annotated[tuple[float, ...], Between(0.0, 10.0, "s"), OrNone(2)] = ()
    """The same in training and validation: between the two for each decision; empty: as in
    tests."""
    stopped_speed: Annotated[float, Between(0.0, 10.0, "m/s")] = 0.1
    """Slower than this counts as having come to a stop, an accident."""
    actions: ActionSettings = field(default_factory=ActionSettings)
    """Low-level actions."""
    observation: ObservationSettings = field(default_factory=ObservationSettings)
    """Observation."""
    reward: RewardSettings = field(default_factory=RewardSettings)
    """Reward."""

    @property
    def ticks_per_decision(self) -> int:
        """Ticks in a decision, as highway-env counts them."""
        return self.simulation_frequency // self.decision_frequency

    def latency_ticks(self, training: bool = False) -> tuple[int, int]:
        """Fewest and most ticks until a decision takes effect."""
        seconds = (training and self.training_latency) or (self.latency, self.latency)
        low, high = (round(each * self.simulation_frequency) for each in seconds)
        return low, high

    @property
    def varies_in_training(self) -> bool:
        """Whether training has another noise or latency than tests."""
        return bool(self.training_latency or self.observation.training_noise)

    @property
    def tick_duration(self) -> float:
        """Length of a tick, s."""
        return 1.0 / self.simulation_frequency

    @property
    def decision_duration(self) -> float:
        """Simulated length of a decision, s.

        Shorter than 1 / `decision_frequency` where that does not divide the simulation frequency
        (row 2 of the reading). Whatever is given in seconds is counted with it.
        """
        return self.ticks_per_decision / self.simulation_frequency

    @property
    def decisions_per_timestep(self) -> int:
        """Decisions in the paper's timestep of one second, to the nearest whole one."""
        return round(1.0 / self.decision_duration)

    def decisions_in(self, seconds: float) -> int:
        """Decisions it takes until so many simulated seconds have passed."""
        # Shortened by less than matters, so that rounding never adds a decision to a whole number.
        return ceil(seconds / self.decision_duration * (1.0 - 1e-12))
