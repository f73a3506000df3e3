"""Fill the results of ``README.md`` and write ``docs/results.md`` from the stored result files.

python docs/make_results.py
"""

import json
from pathlib import Path
from statistics import mean
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- results -->", "<!-- /results -->"
STORED = ("quick-single-level.json", "quick.json")
COLUMNS = (
    ("accumulated_reward", "reward", 1.0, 2, ""),
    ("average_speed", "speed", 1.0, 2, " m/s"),
    ("success_rate", "success", 100.0, 2, " %"),
    ("travel_distance", "distance", 1.0, 1, " m"),
    ("accident_rate", "accidents", 100.0, 2, " %"),
)
PUBLISHED = {
    "single-level": (3.32, 10.29, 0.0, 257.29, 0.0),
    "hierarchical": (13.20, 13.42, 0.9767, 331.60, 0.0233),
}
Rows = list[dict[str, Any]]


def main() -> None:
    """Write both files."""
    for path, text in pages().items():
        path.write_text(text)


def pages() -> dict[Path, str]:
    """What the two files must hold."""
    paths = [ROOT / "results" / name for name in STORED]
    stored = [json.loads(path.read_text()) for path in paths if path.exists()]
    readme = ROOT / "README.md"
    head, rest = readme.read_text().split(BEGIN)
    tail = rest.split(END)[1]
    return {
        readme: head + BEGIN + "\n\n" + _summary(stored) + "\n" + END + tail,
        ROOT / "docs" / "results.md": _details(stored),
    }


def _summary(stored: Rows) -> str:
    """The paper's table with ours beside it, means over seeds."""
    every = [row for study in stored for row in study["rows"]]
    lines = [
        "| " + " | ".join(["test episodes of 25 s", *(c[1] for c in COLUMNS)]) + " |",
        "|---|" + "---:|" * len(COLUMNS),
    ]
    for controller, published in PUBLISHED.items():
        values = dict(zip((c[0] for c in COLUMNS), published, strict=True))
        lines.append(_line(f"{controller}, published", [values]))
        for world, title in (("lanewise", "here"), ("highway_env", "in highway-env")):
            rows = [r for r in every if r["controller"] == controller and r.get(world)]
            if rows:
                seeds = f"{len(rows)} seeds of {rows[0][world]['episodes']}"
                lines.append(_line(f"{controller}, {title} ({seeds})", [r[world] for r in rows]))
    made = " and ".join(f"`{study['command']}` ({study['date'][:10]})" for study in stored)
    machine = stored[-1]["machine"]
    lines += [
        "",
        f"Preset `quick`, all seeds, none left out; made by {made} on {machine['cores']} cores "
        f"of an {machine['processor']}. Every seed is in [docs/results.md](docs/results.md), "
        "the stored figures are in `results/`.",
    ]
    return "\n".join(lines) + "\n"


def _line(title: str, group: Rows) -> str:
    cells = [f"{mean(r[k] for r in group) * s:.{d}f}{u}" for k, _, s, d, u in COLUMNS]
    return f"| {title} | " + " | ".join(cells) + " |"


def _details(stored: Rows) -> str:
    """Every seed by itself."""
    every = [row for study in stored for row in study["rows"]]
    lines = [
        "# Results, seed by seed",
        "",
        "Written by `python docs/make_results.py` from `results/quick*.json`, not by hand. Weights",
        "were chosen on validation starts; each controller drove the test starts once. `same` is",
        "the share of starts that end alike (success and accident) in both worlds.",
    ]
    for controller in PUBLISHED:
        rows = [r for r in every if r["controller"] == controller]
        if rows:
            lines += ["", f"## {controller}", "", *_seed_table(rows)]
    return "\n".join(lines) + "\n"


def _seed_table(rows: Rows) -> list[str]:
    names = [c[1] for c in COLUMNS]
    lines = [
        "| seed | " + " | ".join(names) + " | highway-env: success | accidents | same | training |",
        "|---:|" + "---:|" * (len(names) + 4),
    ]
    for row in sorted(rows, key=lambda r: int(r["seed"])):
        own = _line(str(row["seed"]), [row["lanewise"]])
        theirs = row.get("highway_env")
        if theirs:
            same = 1 - len(row["differing"]) / theirs["episodes"]
            shares = (theirs["success_rate"], theirs["accident_rate"], same)
            beside = " | ".join(f"{100 * share:.1f} %" for share in shares)
        else:
            beside = "- | - | -"
        lines.append(f"{own} {beside} | {row['train_seconds']:.0f} s |")
    worst = min(rows, key=lambda r: float(r["lanewise"]["success_rate"]))
    lines += [_line("mean", [r["lanewise"] for r in rows]) + " | | | |"]
    if worst["controller"] == "hierarchical":
        share = 100 * worst["lanewise"]["success_rate"]
        lines += ["", f"The worst seed is {worst['seed']} with {share:.2f} % success."]
    return lines


if __name__ == "__main__":
    main()
