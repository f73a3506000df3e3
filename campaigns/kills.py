"""Kill a process while it saves checkpoints, or let its writes fail: what is left is whole.

    python campaigns/kills.py --kills 300 --out results/trust/kills.json

A child process saves checkpoint after checkpoint. It is killed at a random moment (``signal``); or
before, amid or after its n-th system call that writes, for every n of a save (``call``); or that
call fails (``error``). Afterwards the newest valid checkpoint must be the last one saved or the one
under way, with every number as it was written; saving must work again; and no partial checkpoint
may have a name.
"""

import errno
import itertools
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import record

from lanewise.errors import CheckpointError, LanewiseError
from lanewise.runs import checkpoint
from lanewise.system import folder_io
from lanewise.system.progress import Progress

DIGEST, FIRST = "d" * 64, 3
"""`FIRST` checkpoints are saved before anything goes wrong."""
CALLS = ("open", "write", "fsync", "replace", "unlink")
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS, errno.EMFILE)


def contents(number):
    """The arrays of checkpoint ``number``. Sizes differ, so that no two are mistaken."""
    rng = np.random.default_rng(number)
    return {
        "weights": rng.normal(size=(200 + number % 7, 300)).astype(np.float32),
        "replay": rng.integers(0, 255, 1_000_000 + number, dtype=np.uint8),
    }


def save(folder, number):
    """Save checkpoint ``number`` as a training does."""
    name = checkpoint.checkpoint_name(0, number)
    with folder_io.OpenFolder(folder) as place:
        checkpoint.save(place, name, contents(number), {"number": number}, DIGEST, keep=2)


def newest(folder):
    """The number of the newest valid checkpoint, 0 without one, and what is wrong with others."""
    found, problems = checkpoint.newest_valid(folder, None, DIGEST)
    number = 0 if found is None else found.meta["number"]
    for name, array in contents(number).items() if number else ():
        if found.tree[name].tobytes() != array.tobytes():
            raise CheckpointError(f"checkpoint {number} holds other {name} than were saved")
    return number, problems


def save_forever(folder, sabotage, saved):
    """The child; ``saved`` is the number of the last checkpoint it has saved."""
    folder.mkdir()
    with suppress(OSError):
        for number in itertools.count(1):
            if number == FIRST + 1:
                sabotage()
            save(folder, number)
            saved.value = number


def run(folder, sabotage=lambda: None, seconds=None):
    """Let a child save until it ends; returns the number of the last checkpoint it has saved.

    ``sabotage`` is called in it after its first checkpoints; after ``seconds`` it is killed.
    """
    # Without a lock, which a kill might leave locked.
    saved = get_context("fork").RawValue("i", 0)
    child = get_context("fork").Process(target=save_forever, args=(folder, sabotage, saved))
    child.start()
    while child.is_alive() and saved.value < FIRST:
        time.sleep(0.001)
    child.join(seconds)
    child.kill()
    child.join()
    return saved.value


def at_call(number, action):
    """Sabotage: ``action`` replaces the n-th writing call, counted from 0.

    It is given the call, and a function that writes half of what the call would.
    """
    counter = itertools.count()

    def wrap(system_call, *arguments, **named):
        def half():
            if system_call.__name__ == "write":
                system_call(arguments[0], bytes(arguments[1][: len(arguments[1]) // 2]))

        call = partial(system_call, *arguments, **named)
        return action(call, half) if next(counter) == number else call()

    for name in CALLS:
        setattr(folder_io.os, name, partial(wrap, getattr(os, name)))


def die(call, half, when="before"):
    """The process is killed before, amid or after the call."""
    with suppress(OSError):  # A file that is to be deleted need not exist.
        {"before": lambda: None, "amid": half, "after": call}[when]()
    os.kill(os.getpid(), signal.SIGKILL)


def fail(call, half, code):
    """The call fails half-way."""
    half()
    raise OSError(code, os.strerror(code))


def judge(folder, last):
    """What is wrong with what is left after checkpoint ``last`` was saved; empty if nothing."""
    try:
        number, problems = newest(folder)
        if number not in (last, last + 1) or problems:
            return f"saved {last}, found {number}; {problems}"
        save(folder, last + 2)
        number, _ = newest(folder)
        left = [path.name for path in folder.iterdir() if path.name.endswith(folder_io.PARTIAL)]
        return "" if number == last + 2 and not left else f"saving again left {number}, {left}"
    except (LanewiseError, OSError) as error:
        return str(error)


def cases(place, kills, rng):
    """(kind, label, arguments of `run`) of each case."""
    calls = 0
    while run(place / f"count-{calls}", partial(at_call, calls, die)) == FIRST:
        calls += 1
    for _ in range(kills):
        yield "signal", "a random moment", {"seconds": float(rng.uniform(0.0, 0.06))}
    for number, when in itertools.product(range(calls), ("before", "amid", "after")):
        sabotage = partial(at_call, number, partial(die, when=when))
        yield "call", f"killed {when} call {number}", {"sabotage": sabotage}
    for number, code in itertools.product(range(calls), ERRORS):
        sabotage = partial(at_call, number, partial(fail, code=code))
        yield "error", f"{errno.errorcode[code]} at call {number}", {"sabotage": sabotage}


def main():
    """Run the campaign, store what it found, and exit with 1 if anything is wrong."""
    arguments = record.parse(__doc__, "kills", kills=300)
    moments, left_valid, wrong = Counter(), Counter(), []
    with tempfile.TemporaryDirectory() as place, Progress() as progress:
        every = list(cases(Path(place), arguments.kills, np.random.default_rng(arguments.seed)))
        progress.stage("moments", len(every))
        for number, (kind, label, how) in enumerate(every):
            folder = Path(place) / str(number)
            last = run(folder, **how)
            left_valid["new" if newest(folder)[0] > last else "old"] += 1
            if problem := judge(folder, last):
                wrong.append({"kind": kind, "at": label, "what": problem})
            moments[kind] += 1
            shutil.rmtree(folder)
            progress.update(number + 1, wrong=len(wrong))
    kills = moments["signal"] + moments["call"]
    found = {"moments": dict(moments), "kills": kills, "left_valid": dict(left_valid)}
    record.store(arguments.out, found | {"wrong": wrong}, arguments.seed)
    print(f"{found['moments']}, {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
