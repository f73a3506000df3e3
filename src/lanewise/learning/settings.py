"""Settings of Q-learning. Knows no roads, imports no JAX."""

from dataclasses import dataclass
from typing import Annotated

from lanewise.fields.ranges import Between, OneOf


@dataclass(frozen=True)
class ExplorationSettings:
    """The epsilon schedule, counted in environment steps (decisions) over all worlds (row 15)."""

    schedule: Annotated[str, OneOf(("linear", "exponential"))] = "linear"
    """Shape of the decay: linear reaches the end at `steps`; exponential has `steps` as its
    time constant."""
    start: Annotated[float, Between(0.0, 1.0)] = 0.5
    """First epsilon."""
    end: Annotated[float, Between(0.0, 1.0)] = 0.02
    """Last epsilon."""
    steps: Annotated[int, Between(1, 100_000_000)] = 32_000
    """Environment steps of the decay."""
    counted: Annotated[str, OneOf(("all-worlds", "per-world"))] = "all-worlds"
    """Whether `steps` counts the decisions of all worlds together or those of each world."""


@dataclass(frozen=True)
class LearnerSettings:
    """Double deep Q-learning with replay."""

    hidden: Annotated[tuple[int, ...], Between(1, 65_536)] = (512, 512)
    """Widths of the hidden layers, ReLU between them."""
    layer_normalisation: bool = False
    """Whether outputs of hidden layers are normalised (Ba et al. 2016, without gain and bias)."""
    double: bool = True
    """Double DQN (van Hasselt et al. 2016) or plain DQN (row 16)."""
    discount: Annotated[float, Between(0.0, 1.0)] = 0.8
    """Discount gamma."""
    learning_rate: Annotated[float, Between(1e-8, 1.0)] = 1e-3
    """Adam's step size."""
    final_learning_rate: Annotated[float, Between(1e-8, 1.0)] = 1e-4
    """Adam's step size after a linear fall over `learning_rate_decay` updates."""
    learning_rate_decay: Annotated[int, Between(0, 1_000_000_000)] = 0
    """Updates over which the step size falls from `learning_rate` to `final_learning_rate`;
    0 keeps it constant."""
    batch_size: Annotated[int, Between(1, 65_536)] = 64
    """Transitions in an update."""
    replay_capacity: Annotated[int, Between(1, 10_000_000)] = 50_000
    """Transitions kept; the oldest are overwritten."""
    warm_up: Annotated[int, Between(1, 10_000_000)] = 1_000
    """Environment steps before the first update."""
    target_update: Annotated[str, OneOf(("moving-average", "hard-copy"))] = "moving-average"
    """How the target network follows the online one (row 17)."""
    target_rate: Annotated[float, Between(1e-6, 1.0)] = 0.01
    """Moving average: share of the online network taken at each update."""
    target_interval: Annotated[int, Between(1, 1_000_000)] = 50
    """Hard copy: updates between copies."""
