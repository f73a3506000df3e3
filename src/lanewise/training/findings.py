"""What was not finite in a chunk, and since when: the host's reading of `finite`."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lanewise.training.finite_checks import ChunkFinite


@dataclass(frozen=True)
class Finding:
    """Something that is not finite."""

    what: str
    """``observation``, ``reward``, ``vehicles``, ``transitions``, ``loss`` or ``weights``; or
    ``validation``, where something of that kind was found in the test episodes after the chunk."""
    level: str = ""
    """Whose transitions, loss or weights."""
    iteration: int | None = None
    """Of the chunk, from 1 on, that left it behind; 0: the chunk began with it; None: some."""
    world: int | None = None
    """Number of the world, from 0 on."""

    def said(self, decisions: int, worlds: int) -> str:
        """In words, after so many decisions in so many worlds."""
        words = {
            "observation": "an observation is not finite",
            "reward": "a reward is not finite",
            "vehicles": "the state of a car is not finite",
            "transitions": f"{self.level} was paid or shown a number that is not finite",
            "loss": f"the loss of {self.level} is not finite",
            "weights": f"the weights of {self.level} are not finite",
        }[self.what]
        if self.iteration is None:
            return words if self.world is None else f"{words}, in world {self.world}"
        if self.world is None:
            return f"{words} since decision {decisions + self.iteration * worlds}"
        after = decisions + (self.iteration - 1) * worlds + self.world + 1
        place = f"after decision {after}" if self.iteration else "from the beginning on"
        return f"{words} {place}, in world {self.world}"


def of(finite: ChunkFinite) -> list[Finding]:
    """All that is not finite, what may have caused the rest first.

    What is seen and paid comes before losses and weights: a network without finite weights still
    chooses actions that exist, so it spoils nothing of the road.
    """
    firsts = [_first(what, getattr(finite, what)) for what in ("observation", "reward")]
    found = sorted((one for one in firsts if one is not None), key=lambda one: one.iteration or 0)
    found += [Finding("vehicles", world=int(at)) for at in np.flatnonzero(~finite.vehicles)[:1]]
    found += [Finding("transitions", level) for level in _bad(finite.transitions)]
    losses = [
        Finding("loss", level, iteration=int(np.argmin(finite.loss[level])))
        for level in _bad(finite.loss)
    ]
    found += sorted(losses, key=lambda one: one.iteration or 0)
    return found + [Finding("weights", level) for level in _bad(finite.weights)]


def _first(what: str, finite: Any) -> Finding | None:
    """The first of it that is not finite, by iteration and world; None if all is."""
    bad = np.argwhere(~np.asarray(finite))
    if not len(bad):
        return None
    iteration, world = (int(at) for at in bad[0])
    return Finding(what, iteration=iteration, world=world)


def _bad(levels: dict[str, Any]) -> Iterator[str]:
    """The levels of which something is not finite."""
    return (name for name, finite in levels.items() if not np.all(finite))
