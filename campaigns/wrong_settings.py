"""Make mistakes in settings, thousands of them, at every door, and see that each is refused well.

python campaigns/wrong_settings.py --each 30 --out results/trust/wrong-settings.json

Well: before anything starts, with exit code 2 or an error for people, nothing left on disk, no JAX
imported by the command line, and the right hint: the name that was meant, the type that is
expected, the range, or both of the settings that contradict one another. Doors that need no JAX are
tried in a process of their own, where importing it would show.
"""

import argparse
import json
import random
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import wrong_arguments
import wrong_names
import wrong_pairs
import wrong_values
from wrong_doors import (
    COMMANDS,
    LIGHT,
    SETTING_DOORS,
    Met,
    Mistake,
    command,
    folder,
    given,
    meet,
    together,
)

from lanewise import config
from lanewise.config.settings import Settings

AIM = 0.95
"""Of the mistakes, so many must be refused with the right hint; all must be refused."""
ENVIRONMENT = ("scenario.", "driving.", "goals.", "planner.")
"""Settings that an environment takes."""
SHOWN = 3
"""Settings of one last name that a hint lists at most; with more, one of them must be there."""


def generate(seed, each):
    """Mistakes of every kind at every door.

    Args:
        seed: of what is drawn.
        each: settings drawn for each door and way of being wrong.
    """
    rng = random.Random(seed)
    settings = (*_misspelt(rng, each), *_wrong_values(rng, each), *_impossible(rng))
    return [*settings, *wrong_arguments.misspelt(rng, each), *wrong_arguments.wrong()]


def _known(door):
    return [
        n for n in config.field_types() if door != "gymnasium.make" or n.startswith(ENVIRONMENT)
    ]


def _misspelt(rng, each):
    flat = config.flatten(Settings())
    for door in SETTING_DOORS:
        known = _known(door)
        sections = sorted({name.rpartition(".")[0] for name in known})
        for how in (*wrong_names.SETTING_SLIPS, wrong_names.wrong_section):
            more = (sections,) if how is wrong_names.wrong_section else ()
            for name in rng.sample(known, min(each, len(known))):
                wrong = how(rng, name, *more)
                if wrong in known or _is_right(door, wrong, known):
                    continue
                what = given(door, wrong, wrong_values.right(flat[name]))
                hint = (_meant(how, name, known) + _section(door, wrong, name),)
                yield Mistake("misspelt", wrong_arguments.in_words(how), door, what, hint)


def _is_right(door, wrong, known):
    """Whether a door takes this spelling after all."""
    if door in ("command line", "file"):
        wrong = wrong.replace("-", "_")
    if door in ("gymnasium.make", "lanewise.train"):
        return sum(name == wrong or name.endswith(f".{wrong}") for name in known) == 1
    return wrong in known


def _meant(how, name, known):
    """Names of which one must stand in the hint: the one that was meant.

    Without its section, or in another, a name may mean several settings: then any of these.
    """
    sections = ("no_section", "no_section_and_slip", "no_inner_section", "wrong_section")
    leaf = name.rpartition(".")[2]
    same = [other for other in known if other.rpartition(".")[2] == leaf]
    if how.__name__ in sections and (len(same) > SHOWN or how.__name__ == "wrong_section"):
        return tuple(same)
    return (name,)


def _section(door, wrong, name):
    """In a file, the section that was meant, where that is what is misspelt."""
    theirs, ours = wrong.split(".")[:-1], name.split(".")[:-1]
    if door != "file" or len(theirs) != len(ours) or theirs == ours:
        return ()
    first = next(place for place in range(len(ours)) if theirs[place] != ours[place])
    return (".".join(ours[: first + 1]),)


def _wrong_values(rng, each):
    kinds = config.field_types()
    for door in SETTING_DOORS:
        known = _known(door)
        offers = {}
        for name in known:
            for value in (
                *wrong_values.wrong_types(kinds[name]),
                *wrong_values.out_of_range(kinds[name]),
            ):
                what = given(door, name, value)
                if what is not None:
                    key = (value.kind, value.how)
                    offers.setdefault(key, []).append((name, what, value.hint))
        for (kind, how), several in offers.items():
            for name, what, hint in rng.sample(several, min(each, len(several))):
                yield Mistake(kind, how, door, what, ((name,), *hint))


def _impossible(rng):
    """What the machine's memory cannot hold is refused only where a training would begin."""
    for door in SETTING_DOORS:
        known = _known(door)
        for rule, flags, hint in wrong_pairs.pairs(rng):
            trains = door not in ("compose", "gymnasium.make")
            if flags.keys() <= set(known) and (trains or "GiB" not in str(hint)):
                yield Mistake("impossible", rule, door, together(door, flags), hint)


def hinted(mistake, message):
    """Whether the message holds the right hint."""
    # A misspelt name is quoted first, and the right one may be part of it.
    said = re.sub(r'"[^"]*"', "", message, count=1) if mistake.kind == "misspelt" else message
    return all(
        any(_stands_in(_plain(text), _plain(said)) for text in group) for group in mistake.hint
    )


def _plain(text):
    """A flag and a dotted name are spelt alike."""
    return text.replace("--", " ").replace("-", "_").strip()


def _stands_in(text, said):
    return re.search(rf"(?<![\w.]){re.escape(text)}(?![\w]|\.\w)", said) is not None


def run(mistakes, told=lambda done: None):
    """What became of each mistake, here in this process; ``told`` how many are done."""
    found = []
    with folder():
        for mistake in mistakes:
            found.append(meet(mistake))
            told(len(found))
    return found


def apart(seed, each, told=lambda done: None):
    """As `run`, of the doors that need no JAX, in a process of their own.

    A process that may import anything would not show who imports JAX.
    """
    words = [sys.executable, __file__, "--light", "--seed", str(seed), "--each", str(each)]
    found = []
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            found.append(Met(**json.loads(line)))
            told(len(found))
    if process.returncode:
        raise SystemExit("the process of the light doors failed")
    return found


def fresh(mistakes, told=lambda done: None):
    """Those that began something in a process and an output folder of their own, and what.

    Here nothing is in the way of what is not refused; after a minute it counts as begun.
    """
    wrong = []
    for number, mistake in enumerate(mistakes, 1):
        with folder() as place:
            words = command(mistake, "fresh")
            try:
                done = subprocess.run(
                    [sys.executable, "-m", "lanewise", *words],
                    capture_output=True, text=True, check=False, timeout=60,
                )  # fmt: skip
                met = (done.returncode, "Traceback" in done.stderr, (place / "fresh").exists())
            except subprocess.TimeoutExpired:
                met = ("it began",)
            if met != (2, False, False):
                wrong.append({"words": words, "met": list(met)})
        told(number)
    return wrong


def split(mistakes):
    """(those of the doors that need no JAX, the others)."""
    return (
        [mistake for mistake in mistakes if mistake.door in LIGHT],
        [mistake for mistake in mistakes if mistake.door not in LIGHT],
    )


def figures(mistakes, met):
    """The result: counts by kind and door, the share with the right hint, and every failure."""
    pairs = list(zip(mistakes, met, strict=True))
    let_in = [(m, r) for m, r in pairs if not r.refused or r.wrong]
    without = [(m, r) for m, r in pairs if r.refused and not r.wrong and not hinted(m, r.message)]
    right = len(pairs) - len(let_in) - len(without)
    return {
        "mistakes": len(pairs),
        "refused": sum(r.refused and not r.wrong for _, r in pairs),
        "with_the_right_hint": right,
        "hint_rate": round(right / len(pairs), 4),
        "by_kind_and_door": _table(pairs),
        "let_in": [_told(m, r) for m, r in let_in],
        "without_the_right_hint": [_told(m, r) for m, r in without],
    }


def _table(pairs):
    table = {}
    for kind in dict.fromkeys(m.kind for m, _ in pairs):
        of = [(m, r) for m, r in pairs if m.kind == kind]
        made = Counter(m.door for m, _ in of)
        right = Counter(m.door for m, r in of if hinted(m, r.message))
        table[kind] = {d: {"made": n, "right_hint": right[d]} for d, n in made.items()}
    return table


def _told(mistake, met):
    what = mistake.given if isinstance(mistake.given, str | list) else repr(mistake.given)
    what = " ".join(what) if isinstance(what, list) else what
    return {
        "kind": mistake.kind,
        "how": mistake.how,
        "door": mistake.door,
        "given": what[:300],
        "meant": [list(group)[:4] for group in mistake.hint],
        "message": met.message[:300],
        **({"wrong": met.wrong} if met.wrong else {}),
    }


def main():
    """Run the campaign and store its result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=30, help="settings for each way and door")
    parser.add_argument("--fresh", type=int, default=40, help="tried in a process of their own")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/wrong-settings.json"))
    parser.add_argument("--light", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.light:
        return light(arguments.seed, arguments.each)
    from record import store

    from lanewise.system.progress import Progress

    lightly, others = split(generate(arguments.seed, arguments.each))
    programs = [mistake for mistake in lightly if mistake.door in COMMANDS]
    some = random.Random(arguments.seed).sample(programs, min(arguments.fresh, len(programs)))
    with Progress() as progress:
        progress.stage("fresh processes", len(some))
        began = fresh(some, progress.update)
        progress.stage("doors without JAX", len(lightly))
        met = apart(arguments.seed, arguments.each, progress.update)
        progress.stage("doors with JAX", len(others))
        met += run(others, progress.update)
    found = figures(lightly + others, met)
    found |= {"fresh_processes": len(some), "fresh_processes_wrong": began}
    store(arguments.out, found, seed=arguments.seed)
    print(
        f"{found['mistakes']} mistakes: {found['refused']} refused, "
        f"{found['hint_rate']:.2%} with the right hint; {arguments.out}"
    )
    return 1 if began or found["let_in"] or found["hint_rate"] < AIM else 0


def light(seed, each):
    """The part of `apart`: one line for each mistake."""
    out = sys.stdout
    with folder():
        for mistake in split(generate(seed, each))[0]:
            out.write(json.dumps(vars(meet(mistake))) + "\n")
            out.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
