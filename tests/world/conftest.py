import jax
import numpy as np
import pytest

from lanewise.world import build, road
from lanewise.world.settings import PAPER_DRIVER
from lanewise.world.state import EXTERNAL, RULE_BASED, World


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield


@pytest.fixture
def make_world():
    """Build a world from places; the first vehicle is external unless kinds say otherwise."""

    def make(
        x, lane, speed=12.5, *, y=None, kinds=None, settings=PAPER_DRIVER, lanes=3,
        maximum=None, timer=None, heading=None, dtype=None,
    ):  # fmt: skip
        dtype = dtype or jax.dtypes.canonicalize_dtype(float)
        count = len(x)
        kinds = [EXTERNAL] + [RULE_BASED] * (count - 1) if kinds is None else kinds
        settings = [settings] * count if not isinstance(settings, list) else settings
        y = np.asarray(lane) * 4.0 if y is None else y
        return World(
            road.straight_road(lanes, length=10_000.0, dtype=dtype),
            build.make_drivers(settings, kinds, maximum, dtype),
            build.make_vehicles(
                x, y, np.broadcast_to(speed, count), lane, maximum, heading, timer, dtype
            ),
        )

    return make
