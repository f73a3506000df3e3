"""What vehicles see, as the tests of single functions want it."""

from lanewise.world import motion, neighbours, observers


def look(world):
    """The motion of everyone."""
    return motion.observe(world, motion.heading_trig(world.vehicles))


def neighbours_on(world, seen, lane):
    """Both neighbours of everyone on a lane each."""
    return neighbours.both(world, seen, observers.all_vehicles(world, seen), lane)
