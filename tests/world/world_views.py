"""What vehicles see, as the tests of single functions want it."""

from lanewise.world import motion, neighbours
from lanewise.world import view as views


def look(world):
    """The motion of everyone."""
    return motion.observe(world, motion.facing(world.vehicles))


def neighbours_on(world, seen, lane):
    """Both neighbours of everyone on a lane each."""
    return neighbours.both(world, seen, views.everyone(world, seen), lane)
