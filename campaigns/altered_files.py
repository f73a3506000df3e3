"""Alter files that people pass on in thousands of ways, and load each: all must be refused.

python campaigns/altered_files.py --files 21500 --place whole-files

Every altered file is loaded by the function that the commands load it with. It must be refused
with one of Lanewise's own errors, of one or two lines that name the file or its folder and hold
nothing a terminal would obey, within a second and 256 MB; nothing in its folder may be touched.
Where a file still says the same (white space in JSON, a date in an archive), what is loaded must be
bit for bit what the whole file gives. Three more things are no damage, and are counted apart: a
journal that ends early at the end of a line, as a kill leaves it; settings or an experiment that
people write by hand, without a digest, if what an alteration leaves is valid too; and of two
policies mixed, the second, whole.

Memory is how far the process's resident set grows during the load (VmHWM, reset before it). Time is
the process's own CPU time, as the machine may be shared; wall time is reported beside it.
"""

import argparse
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import record
import strangers_files
from strangers_files import TARGETS, fingerprint

from lanewise.errors import LanewiseError, printable
from lanewise.system.progress import Progress

SECONDS, MEGABYTES = 1.0, 256.0
HANGS = 300
"""Seconds of wall time after which a load is ended: it waits for something that never comes."""
ROOM = 3 * 1024**3
"""Bytes of addresses that a load may take at most, lest a bomb takes the machine."""
BLOCK = 200
TURNS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 1, 1, 3, 4, 7, 8)
"""Places of the targets, in the order in which their files are altered; some come oftener."""


class HangError(BaseException):
    """A load that does not end."""


def measure(target, folder):
    """(outcome, what was loaded or said, CPU seconds, wall seconds, MB) of one load."""
    before = _status("VmRSS", reset=True)
    wall, cpu = time.perf_counter(), time.process_time()
    signal.alarm(HANGS)
    try:
        outcome, said = "loaded", fingerprint(target.load(folder))
    except LanewiseError as error:
        outcome, said = "refused", str(error)
    except HangError:
        outcome, said = "hung", ""
    except Exception:
        outcome, said = "another error", traceback.format_exc(limit=-3)
    finally:
        signal.alarm(0)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return outcome, said, cpu, wall, max(0.0, _status("VmHWM") - before)


def _status(field, reset=False):
    """A figure of this process, MB."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    text = Path("/proc/self/status").read_text()
    return int(re.search(rf"{field}:\s*(\d+) kB", text)[1]) / 1000


def state_of(folder):
    """Everything about a folder that a load could change."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        found[str(path.relative_to(folder))] = (
            *(status.st_mode, status.st_size, status.st_mtime_ns, status.st_ctime_ns),
        )
    return found


def every_way():
    """(place of the target, file, how) of everything that can be done to any file, each once."""
    return [
        (number, name, how)
        for number, target in enumerate(TARGETS)
        for name, special in target.files.items()
        for how in dict.fromkeys((*target.general(name), *special))
    ]


WAYS = every_way()


def choose(number, rng):
    """What is done to the file of a number: first everything once, then at random."""
    if number < len(WAYS):
        return WAYS[number]
    place = TURNS[number % len(TURNS)]
    target = TARGETS[place]
    name = list(target.files)[rng.integers(len(target.files))]
    special = target.files[name]
    # As often by what its kind allows as by what any file allows.
    kinds = special if special and rng.integers(2) else target.general(name)
    return place, name, kinds[rng.integers(len(kinds))]


def alter(target, name, how, rng, folder, other):
    """Alter a file; whether anything changed."""
    file = folder / name
    before = file.read_bytes()
    how(rng, file, other / name)
    plain = file.is_file() and not file.is_symlink() and file.stat().st_size < 10**8
    if not plain or how.__name__.startswith("signed"):
        return True
    # Where only the other whole file is left, nothing of it is altered.
    lone = len(target.files) == 1 and file.read_bytes() == (other / name).read_bytes()
    return not lone and file.read_bytes() != before


def judge(target, folder, whole, touched, found):
    """What is wrong with how an altered file was taken; empty if nothing is."""
    outcome, said, cpu, _, megabytes = found
    if touched:
        return "touched"
    if outcome == "loaded":
        return {"altered": "loaded altered", "not finite": "loaded what is not finite"}.get(
            _kind_of_load(target, said, whole), ""
        )
    if outcome != "refused":
        return outcome
    if cpu > SECONDS:
        return "slow"
    if megabytes > MEGABYTES:
        return "memory"
    if not 1 <= len(said.splitlines()) <= 2 or printable(said) != said or len(said) > 1000:
        return "unreadable"
    return "" if str(folder) in said and len(said) > len(str(folder)) + 10 else "vague"


def one(place, number, seed, wholes):
    """Alter and load the file of a number; a row of figures, or None where nothing changed."""
    rng = np.random.default_rng([seed, number])
    place_of, name, how = choose(number, rng)
    target = TARGETS[place_of]
    folder = place / f"altered-{os.getpid()}"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place / "whole" / target.name, folder)
    if not alter(target, name, how, rng, folder, place / "other" / target.name):
        return None
    before = state_of(folder)
    found = measure(target, folder)
    whole = wholes[target.name] | {
        "cut": is_cut(folder / name, place / "whole" / target.name / name)
    }
    problem = judge(target, folder, whole, before != state_of(folder), found)
    outcome, said, cpu, wall, megabytes = found
    if outcome == "loaded":
        said = "" if not problem else said[:2000]
        outcome = _kind_of_load(target, found[1], whole)
    return {
        "number": number,
        "target": target.name,
        "file": name,
        "how": how.__name__,
        "outcome": outcome,
        "problem": problem,
        "said": said.replace(str(folder), "FOLDER"),
        "cpu": cpu,
        "wall": wall,
        "megabytes": megabytes,
    }


def is_cut(file, original):
    """Whether of an altered file's whole lines the original begins with all."""
    if not file.is_file() or file.stat().st_size > original.stat().st_size:
        return False
    lines = file.read_bytes().rpartition(b"\n")
    return original.read_bytes().startswith(lines[0] + lines[1])


def is_beginning(target, said, whole):
    """Whether a journal was loaded up to some line, as if a kill had cut the rest."""
    if target.name != "journal of a sweep":
        return False
    results, every = json.loads(said)[1], json.loads(whole)[1]
    return results == every[: len(results)]


def _is_finite(said):
    """Whether what was loaded holds neither NaN nor infinities, whatever its texts say."""
    found = []
    json.loads(said, parse_constant=found.append)
    return not found


def _kind_of_load(target, said, whole):
    """What a file that was loaded is: ``altered`` and ``not finite`` should not have been."""
    if said == whole["whole"]:
        return "same"
    if not target.signed:
        return "valid by hand" if _is_finite(said) else "not finite"
    if said == whole["other"]:
        # Of a mixture, the list of an archive's members decides: nothing of the first is left.
        return "the other"
    return "beginning" if whole["cut"] and is_beginning(target, said, whole["whole"]) else "altered"


def block(place, first, last, seed, guarded=True):
    """Many files, in this process, which loads every whole file before and after.

    Args:
        place: what `strangers_files.make` made.
        first: number of the first file.
        last: after that of the last.
        seed: of the alterations.
        guarded: whether the process may be denied memory from here on.
    """
    heard = signal.signal(signal.SIGALRM, _hang)
    before = _load_whole(place)
    if guarded:
        _limit()
    rows = [one(place, number, seed, before) for number in range(first, last)]
    signal.signal(signal.SIGALRM, heard)
    if _load_whole(place) != before:
        raise AssertionError("whole files load otherwise after altered ones")
    return [row for row in rows if row is not None]


def _load_whole(place):
    """By target, what the whole files give; of policies, which stand alone, also the others."""
    found = {}
    for each in TARGETS:
        twins = ("whole", "other") if each.name.startswith("exported") else ("whole",)
        loaded = {twin: fingerprint(each.load(place / twin / each.name)) for twin in twins}
        found[each.name] = {"other": None} | loaded
    return found


def _hang(*_):
    raise HangError


def _limit():
    taken = int(_status("VmSize") * 1000) * 1000
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, hard))


def run(place, files, seed, processes, reporter):
    """Rows of all files; ``place`` holds what `strangers_files.make` made."""
    reporter.stage("altered files", files)
    blocks = [(at, min(at + BLOCK, files)) for at in range(0, files, BLOCK)]
    rows, bad = [], 0
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        pending = [pool.submit(block, place, first, last, seed) for first, last in blocks]
        for future in pending:
            found = future.result()
            rows += found
            for row in found:
                if row["problem"]:
                    reporter.note(f"{row['problem']}: {row['number']}, {row['file']}, {row['how']}")
            bad = sum(bool(row["problem"]) for row in rows)
            reporter.update(len(rows), problems=bad)
    return rows


def kind_of(message):
    """A message without what is of one file alone."""
    text = re.sub(r"FOLDER\S*", "FILE", message.splitlines()[0])
    text = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "…", text)
    return re.sub(r"[0-9]+", "N", text)[:90]


def figures(rows):
    """What goes into the result file."""
    refused = [row for row in rows if row["outcome"] == "refused"]
    messages = Counter(kind_of(row["said"]) for row in refused)
    examples = {}
    for row in refused:
        examples.setdefault(f"{row['file']}: {row['how']}", row["said"][:300])
    return {
        "altered": len(rows),
        "refused": len(refused),
        "same_as_whole": sum(row["outcome"] == "same" for row in rows),
        "whole_beginning_of_a_journal": sum(row["outcome"] == "beginning" for row in rows),
        "another_valid_file_by_hand": sum(row["outcome"] == "valid by hand" for row in rows),
        "the_other_whole_policy": sum(row["outcome"] == "the other" for row in rows),
        "problems": [row for row in rows if row["problem"]][:50],
        "problem_count": sum(bool(row["problem"]) for row in rows),
        "slowest_cpu_s": round(max(row["cpu"] for row in rows), 4),
        "slowest_wall_s": round(max(row["wall"] for row in rows), 4),
        "most_memory_mb": round(max(row["megabytes"] for row in rows), 1),
        "by_target": _table(rows, "target"),
        "by_kind": _table(rows, "how"),
        "messages": dict(messages.most_common()),
        "examples": dict(sorted(examples.items())),
    }


def _table(rows, field):
    """Counts by a field: altered, refused, the same as the whole file, another valid file."""
    table = {}
    for row in rows:
        counts = table.setdefault(row[field], Counter())
        counts["altered"] += 1
        counts[row["outcome"]] += 1
    return {name: dict(counts) for name, counts in sorted(table.items())}


def main():
    """Alter, load, and store the result; 1 if anything was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=21_500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--place", type=Path, help="folder with the whole files, made if missing")
    parser.add_argument("--out", type=Path, default=Path("results/trust/altered-files.json"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, Progress() as reporter:
        # Whole, so that a link made there leads where it should.
        place = (arguments.place or Path(temporary)).resolve()
        if not (place / "whole").exists():
            reporter.note("training the runs whose files are altered")
            strangers_files.make(place, real=True)
        began = time.monotonic()
        rows = run(place, arguments.files, arguments.seed, arguments.processes, reporter)
        found = figures(rows) | {
            "limits": {"seconds": SECONDS, "megabytes": MEGABYTES},
            "seconds": round(time.monotonic() - began, 1),
            "whole_files": strangers_files.describe(place / "whole"),
        }
    record.store(arguments.out, found, arguments.seed, packages=("safetensors",))
    print(f"{found['refused']} refused, {found['problem_count']} problems")
    sys.exit(1 if found["problem_count"] else 0)


if __name__ == "__main__":
    main()
