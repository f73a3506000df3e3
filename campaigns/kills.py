"""Kill a process while it saves checkpoints, fill its disk, break its disk: what is left is whole.

python campaigns/kills.py --kills 300 --out results/trust/kills.json

A child saves checkpoint after checkpoint and tells after each that it is saved.

- ``signal``: it is killed at a random moment.
- ``call``: it kills itself before, amid or after its n-th call of the system that writes, for
  every n of a whole save, pruning included.
- ``error``: its n-th such call fails, for every n, with each of several errors.
- ``limit``: the system refuses to let a file grow beyond so many bytes.
- ``full``: the files lie on a disk that is really full, where the system lets us make one.

Afterwards the newest valid checkpoint must be the last one told, or the one under way, with every
number as it was written; saving must work again; and a whole checkpoint must never be named half.
"""

import argparse
import errno
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import record

from lanewise.errors import CheckpointError
from lanewise.runs import checkpoint
from lanewise.system import folder_io
from lanewise.system.progress import Progress

DIGEST, KEPT = "d" * 64, 2
FIRST = 3
"""So many checkpoints are there before anything goes wrong."""
CALLS = ("open", "write", "fsync", "replace", "unlink")
"""Of `lanewise.system.folder_io` to the system; new folders go through Path."""
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS, errno.EMFILE)
LIMITS = (0, 1, 1000, 100_000, 1_000_000)
"""Bytes a file may have."""
LEFT = (0, 4096, 500_000, 1_200_000)
"""Bytes left free on a disk that is filled; a checkpoint wants a little more."""


def contents(number):
    """What checkpoint ``number`` holds; sizes differ, so that no two are mistaken."""
    rng = np.random.default_rng(number)
    return {
        "weights": rng.normal(size=(200 + number % 7, 300)).astype(np.float32),
        "replay": rng.integers(0, 255, 1_000_000 + number, dtype=np.uint8),
        "number": np.int32(number),
    }


def save(folder, number):
    """Save checkpoint ``number`` as a training does."""
    name = checkpoint.checkpoint_name(0, number)
    checkpoint.save(folder, name, contents(number), {"number": number}, DIGEST, keep=KEPT)


def newest(folder):
    """The number of the newest valid checkpoint, every byte of it compared; and the warning."""
    found, warning = checkpoint.newest_valid(folder, None, DIGEST)
    if found is None:
        return 0, warning
    number = found.meta["number"]
    for name, array in contents(number).items():
        if found.tree[name].tobytes() != array.tobytes():
            raise CheckpointError(f"checkpoint {number} holds other {name} than were saved")
    return number, warning


def _child(folder, lay_trap, pipe):
    """Save for ever, telling after each; the trap is laid after the first few."""
    for number in range(1, 10_000):
        if number == FIRST + 1:
            lay_trap()
        try:
            save(folder, number)
        except OSError:
            return
        pipe.send(number)


def run(folder, lay_trap, kill_after=None):
    """A child that saves until it ends.

    Args:
        folder: where.
        lay_trap: called in the child, so that something goes wrong there.
        kill_after: seconds after the first checkpoints after which it is killed, or None.

    Returns:
        The number of the last checkpoint told as saved.
    """
    here, there = get_context("fork").Pipe(duplex=False)
    child = get_context("fork").Process(target=_child, args=(folder, lay_trap, there))
    child.start()
    there.close()
    told, deadline = 0, None
    try:
        while True:
            if deadline is not None and not here.poll(max(0.0, deadline - time.monotonic())):
                os.kill(child.pid, signal.SIGKILL)
                deadline = None
            told = here.recv()
            if kill_after is not None and told == FIRST:
                deadline, kill_after = time.monotonic() + kill_after, None
    except EOFError:
        child.join()
    return told


def no_trap():
    """Nothing goes wrong by itself."""


def at_call(number, action):
    """A trap: ``action(call, arguments)`` in place of the n-th writing call, counted from 0."""

    left = [number]

    def wrap(call):
        def wrapped(*arguments, **named):
            left[0] -= 1
            if left[0] == -1:
                return action(call, arguments, named)
            return call(*arguments, **named)

        return wrapped

    def lay():
        for name in CALLS:
            setattr(folder_io.os, name, wrap(getattr(os, name)))

    return lay


def die_before(call, arguments, named):
    """The kill comes before the call."""
    os.kill(os.getpid(), signal.SIGKILL)


def die_amid(call, arguments, named):
    """Half of what was to be written is; other calls are done or not."""
    if call.__name__ == "write":
        descriptor, data = arguments
        call(descriptor, bytes(data[: len(data) // 2]))
    os.kill(os.getpid(), signal.SIGKILL)


def die_after(call, arguments, named):
    """The kill comes after the call, whether it succeeds or not."""
    with suppress(OSError):  # A file that is to be deleted need not be there.
        call(*arguments, **named)
    os.kill(os.getpid(), signal.SIGKILL)


def fail(code):
    """The call fails; a write leaves half of the data behind."""

    def action(call, arguments, named):
        if call.__name__ == "write":
            call(arguments[0], bytes(arguments[1][: len(arguments[1]) // 2]))
        raise OSError(code, os.strerror(code))

    return action


def limited(size):
    """A trap: no file may grow beyond ``size`` bytes."""

    def lay():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return lay


def calls_of_a_save(place):
    """How many writing calls a save makes that also prunes."""
    folder = place / "count"
    folder.mkdir()
    number = 0
    while True:
        run_folder = folder / str(number)
        told = run(run_folder, at_call(number, die_before))
        if told > FIRST:
            return number
        number += 1


@contextmanager
def small_disk(place):
    """A file system of a few megabytes; None where the system does not let us make one."""
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(place)]
    try:
        made = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        made = False
    try:
        yield place if made else None
    finally:
        if made:
            subprocess.run(["umount", str(place)], check=True)


def judge(folder, told):
    """What is wrong with what is left; empty if nothing is."""
    try:
        number, warning = newest(folder)
        if number not in (told, told + 1):
            return f"told {told}, found {number}"
        if warning:
            return f"a half checkpoint had a name: {warning}"
        save(folder, told + 2)
        number, _ = newest(folder)
        left = [path.name for path in folder.iterdir() if path.name.endswith(folder_io.PARTIAL)]
        if number != told + 2 or left:
            return f"saving again left {number} and {left}"
    except (CheckpointError, OSError) as error:
        return str(error)
    return ""


def cases(place, kills, calls, rng):
    """(kind, label, folder, last told) of each case, one after the other."""
    for number in range(kills):
        after = float(rng.uniform(0.0, 0.06))
        folder = place / f"signal-{number}"
        yield "signal", f"{after:.4f} s", folder, run(folder, no_trap, after)
    for number in range(calls):
        for action in (die_before, die_amid, die_after):
            folder = place / f"{action.__name__}-{number}"
            label = f"{action.__name__} of call {number}"
            yield "call", label, folder, run(folder, at_call(number, action))
    for code in ERRORS:
        for number in range(calls):
            folder = place / f"error-{code}-{number}"
            label = f"{errno.errorcode[code]} at call {number}"
            yield "error", label, folder, run(folder, at_call(number, fail(code)))
    for size in LIMITS:
        folder = place / f"limit-{size}"
        yield "limit", f"{size} bytes", folder, run(folder, limited(size))
    for left in LEFT:
        with small_disk(place / f"full-{left}") as folder:
            if folder is not None:
                told = run(folder, _fill(folder, left))
                (folder / "filler").unlink()
                yield "full", f"{left} bytes left", folder, told


def _fill(folder, left):
    """A trap: fill the disk but for ``left`` bytes."""

    def lay():
        filler = os.open(folder / "filler", os.O_WRONLY | os.O_CREAT)
        written = 0
        with suppress(OSError):  # The disk is full.
            while True:
                written += os.write(filler, bytes(4096))
        os.ftruncate(filler, max(0, written - left))
        os.close(filler)

    return lay


def campaign(kills, seed, place, reporter):
    """All cases.

    Returns:
        How many of each kind, how often the checkpoint under way was there, and what was wrong.
    """
    rng = np.random.default_rng(seed)
    counts, kept, wrong = Counter(), Counter(), []
    calls = calls_of_a_save(place)
    reporter.stage("moments", kills + calls * (3 + len(ERRORS)) + len(LIMITS) + len(LEFT))
    for kind, label, folder, told in cases(place, kills, calls, rng):
        counts[kind] += 1
        reporter.update(sum(counts.values()), wrong=len(wrong))
        if told < FIRST:
            wrong.append({"kind": kind, "at": label, "what": f"only {told} were saved"})
            continue
        kept["new" if newest(folder)[0] > told else "old"] += 1
        if problem := judge(folder, told):
            wrong.append({"kind": kind, "at": label, "what": problem})
        for path in folder.iterdir():
            path.unlink()
    return {
        "calls_of_a_save": calls,
        "moments": dict(counts),
        "kills": counts["signal"] + counts["call"],
        "left_valid": dict(kept),
        "wrong": wrong,
    }


def main():
    """Run the campaign, store what it found, and tell by the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=300, help="killed at random moments")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/kills.json"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, Progress() as reporter:
        figures = campaign(arguments.kills, arguments.seed, Path(place), reporter)
    record.store(arguments.out, figures, arguments.seed)
    print(figures["moments"], f"{len(figures['wrong'])} wrong")
    return 1 if figures["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
