import numpy as np
import pytest
from parity_compare import STATE_TOLERANCE, agree, compare_states
from parity_states import SIZES, random_state

pytestmark = pytest.mark.usefixtures("float64")
STATES = 80
"""Of each size and frequency: one batch shape a size, compiled once."""


@pytest.mark.parametrize(("frequency", "linear"), [(10, False), (15, False), (10, True)])
@pytest.mark.parametrize(
    "size",
    [pytest.param(size, marks=() if size == min(SIZES) else pytest.mark.slow) for size in SIZES],
)
def test_one_tick_from_random_states(size, frequency, linear):
    rng = np.random.default_rng(frequency)
    worlds = []
    while len(worlds) < STATES:
        world = random_state(rng, linear)
        if world.vehicles.x.shape[0] == size:
            worlds.append(world)
    for errors in compare_states(worlds, frequency):
        assert agree(errors, STATE_TOLERANCE).all(), errors
