"""Worlds for the tests of the decision process, built from plain lists."""

import numpy as np

from lanewise.world import build, road
from lanewise.world.settings import PAPER_DRIVER
from lanewise.world.state import CONSTANT, EXTERNAL, World


def world_of(x, y, speed, heading=None, lanes=3, dtype=np.float32):
    """Vehicles as listed, the first one the ego, the others at constant commands."""
    lanes_there = road.straight_road(lanes, dtype=dtype)
    lane = np.clip(np.round(np.asarray(y) / 4.0), 0, lanes - 1).astype(np.int32)
    kinds = [EXTERNAL] + [CONSTANT] * (len(x) - 1)
    return World(
        road=lanes_there,
        drivers=build.make_drivers([PAPER_DRIVER] * len(x), kinds, dtype=dtype),
        vehicles=build.make_vehicles(x, y, speed, lane, heading=heading, dtype=dtype),
    )
