import numpy as np
import pytest
from parity_compare import STATE_TOLERANCE, agrees, compare_states
from parity_states import random_state


@pytest.mark.parametrize("frequency", [10, 15])
def test_one_tick_from_random_states(frequency):
    rng = np.random.default_rng(frequency)
    worlds = [random_state(rng) for _ in range(160)]
    by_size = {}
    for world in worlds:
        by_size.setdefault(world.vehicles.x.shape[0], []).append(world)
    compared = [result for group in by_size.values() for result in compare_states(group, frequency)]
    assert len(compared) == 160
    bad = [result for result in compared if not agrees(*result, STATE_TOLERANCE)]
    assert not bad
