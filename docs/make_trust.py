"""Writes the table of the page on trust from the stored results of the campaigns.

python docs/make_trust.py
"""

import json
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "trust.md"
RESULTS = ROOT / "results" / "trust"
BEGIN, END = "<!-- campaigns -->", "<!-- /campaigns -->"


def main() -> None:
    """Write the page."""
    PAGE.write_text(page())


def page() -> str:
    """What the page must hold."""
    text = PAGE.read_text()
    rows = [_row(name, say) for name, say in SAYINGS.items()]
    table = "\n".join(["| command | when | what came out |", "|---|---|---|", *rows])
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{table}\n\n{END}{rest.split(END)[1]}"


def _row(name: str, say: Callable[[Any], str]) -> str:
    """A campaign's row."""
    path = RESULTS / f"{name}.json"
    if not path.exists():
        return f"| {name} | - | not run to its end yet |"
    found = json.loads(path.read_text())
    return f"| `{found['command']}` | {found['date'][:10]} | {say(found)} |"


def _resumes(found: Any) -> str:
    return (
        f"{found['trials']} trainings stopped {found['stops']} times: "
        f"{found['inside_an_episode']} inside episodes, {found['inside_a_goal']} inside goals, "
        f"{found['epsilon_is_falling']} while epsilon fell; "
        f"{len(found['differences'])} files differ"
    )


def _kills(found: Any) -> str:
    others = sum(found["moments"].values()) - found["kills"]
    return (
        f"{found['kills']} kills and {others} full disks, limits and errors while saving: "
        f"{len(found['wrong'])} times something else than the old or the new checkpoint was left"
    )


def _sameness(found: Any) -> str:
    counts = [len(part) for each in found["controllers"].values() for part in each.values()]
    tests = ", tests of 1 to 230 episodes" if found["counts"] else ""
    return (
        f"{', '.join(found['controllers'])} in {len(found['surroundings'])} surroundings "
        f"({', '.join(found['surroundings'])}){tests}, another seed: {sum(counts)} differences"
    )


def _soak(found: Any) -> str:
    first, *rest = (each["largest_memory_mib"] for each in found["rounds"])
    return (
        f"{len(found['rounds'])} reproductions in {found['minutes']} min, stopped "
        f"{sum(found['stops'].values())} times: {len(found['differences'])} files differ; memory "
        f"of each at most {first:,} MiB in the first, which compiles, {', '.join(map(str, rest))} "
        "in the others"
    )


def _altered(found: Any) -> str:
    return (
        f"{found['altered']:,} altered files: {found['refused']:,} refused, "
        f"{found['same_as_whole']} mean the same and loaded the same, "
        f"{found['whole_beginning_of_a_journal']} are journals cut short, as a kill leaves them, "
        f"{found['another_valid_file_by_hand'] + found['the_other_whole_policy']} are other whole "
        "files; "
        f"{found['problem_count']} problems; at most {found['slowest_cpu_s']} s of CPU and "
        f"{found['most_memory_mb']} MB"
    )


def _settings(found: Any) -> str:
    return (
        f"{found['mistakes']:,} mistakes, {found['refused']:,} refused, "
        f"{100 * found['hint_rate']:.2f} % with the right hint"
    )


def _laws(found: Any) -> str:
    return (
        f"{len(found['laws'])} laws, {found['states']:,} worlds or more each: "
        f"{found['exceptions']} exceptions"
    )


def _learner(found: Any) -> str:
    rows, limit = found["rows"], found["limit"]
    said = (
        f"{len(rows)} learners, {found['updates']:,} updates each, layers of "
        f"{found['hidden'][0]}: largest relative error {found['worst']:.1e}"
    )
    for row in rows:
        if not row["worst"] <= limit:
            name = f"{row['preset']}, {row['stage']}, {row['level']}"
            said += (
                f"; beyond {limit:.0e}: {name}, {row['worst']:.1e}, where the reference with its "
                f"batches in another order differs from itself by {row['reordered']:.1e}"
            )
    share = median(row["reordered"] / row["worst"] for row in rows)
    return f"{said}; over all, that is {share:.2f} times as far (median)"


def _faults(found: Any) -> str:
    return f"{found['caught']} of {found['faults']} deliberate faults caught"


def _coverage(found: Any) -> str:
    return (
        f"tests take {100 * found['share_of_branches']:.1f} % of the package's "
        f"{found['num_branches']:,} branches, workers of `bench` for peers left out"
    )


def _shuffled(found: Any) -> str:
    return (
        f"{found['runs']} runs, {found['tests_run']:,} tests in random order: "
        f"{len(found['failures'])} failures"
    )


def _costs(found: Any) -> str:
    def share(cost: Any) -> str:
        return f"{cost['ratio']:.2f} ({cost['least']:.2f} to {cost['most']:.2f})"

    update, one, many = found["costs"].values()
    return (
        "speed as a share of that without, median and range of "
        f"{update['turns']} turns: an update with a gradient that is the same on any number of "
        f"cores {share(update)}, training of an update a step with the look at its numbers "
        f"{share(one)} in one world and {share(many)} in 32"
    )


def _gates(found: Any) -> str:
    return f"{found['seen_red']} of {found['gates']} gates seen green, then red"


SAYINGS: dict[str, Callable[[Any], str]] = {
    "sameness": _sameness,
    "resumes": _resumes,
    "kills": _kills,
    "soak": _soak,
    "altered-files": _altered,
    "wrong-settings": _settings,
    "laws": _laws,
    "learner": _learner,
    "faults": _faults,
    "coverage": _coverage,
    "shuffled": _shuffled,
    "gates": _gates,
    "costs": _costs,
}
"""By file in `results/trust`, what it says in one line."""


if __name__ == "__main__":
    main()
