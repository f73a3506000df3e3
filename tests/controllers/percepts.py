"""Percepts for the tests of controllers."""

import jax.numpy as jnp

from lanewise.driving.percept import Percept
from lanewise.world import road

ROAD = road.straight_road(3, lanes_max=4)


def percept_of(y=4.0, speed=10.0, heading=0.0, lane=None, features=None):
    lane = round(y / 4.0) if lane is None else lane
    return Percept(
        features=jnp.zeros(26) if features is None else features,
        x=jnp.float32(0.0),
        y=jnp.float32(y),
        heading=jnp.float32(heading),
        speed=jnp.float32(speed),
        lane=jnp.int32(lane),
        road=ROAD,
    )
