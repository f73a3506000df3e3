import numpy as np
import pytest
from parity_compare import STATE_TOLERANCE, agrees, compare_states
from parity_states import SIZES, random_state

STATES = 80
"""Of each size and frequency: one batch shape a size, compiled once."""


@pytest.mark.parametrize("frequency", [10, 15])
def test_one_tick_from_random_states(frequency):
    rng = np.random.default_rng(frequency)
    groups = {size: [] for size in SIZES}
    while any(len(group) < STATES for group in groups.values()):
        world = random_state(rng)
        groups[world.vehicles.x.shape[0]].append(world)
    for group in groups.values():
        compared = compare_states(group[:STATES], frequency)
        assert [result for result in compared if not agrees(*result, STATE_TOLERANCE)] == []
