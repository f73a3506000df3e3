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
READINGS, TRAINING, WORLD = "readings.json", "training.json", "world.json"
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
    stored = [_read(name) for name in STORED]
    readme = ROOT / "README.md"
    head, rest = readme.read_text().split(BEGIN)
    tail = rest.split(END)[1]
    summary = _summary(stored) + "\n" + _speed(_read(WORLD), _read(TRAINING))
    return {
        readme: head + BEGIN + "\n\n" + summary + "\n" + END + tail,
        ROOT / "docs" / "results.md": _details(stored) + _readings(_read(READINGS)),
    }


def _read(name: str) -> Any:
    return json.loads((ROOT / "results" / name).read_text())


def _speed(world: Any, training: Any) -> str:
    """One paragraph on how fast it is."""
    runs = training["runs"]
    seconds, compiling = ([run[key] for run in runs] for key in ("seconds", "compile_seconds"))
    memory = max(run["peak_memory_bytes"] for run in runs) / 2**30
    ours, theirs = _fastest(world)
    return (
        f"Speed on the same machine: {ours:,.0f} decisions a second with 12 vehicles, observations "
        f"and resets included, highway-env {theirs:,.0f} in the same run "
        f"(`{world['command']}`). Training one hierarchical controller takes {min(seconds):.0f} to "
        f"{max(seconds):.0f} s ({len(runs)} seeds), of them {min(compiling):.0f} to "
        f"{max(compiling):.0f} s compiling, and at most {memory:.2f} GiB "
        f"(`{training['command']}`).\n"
    )


def _fastest(world: Any) -> tuple[float, float]:
    """(ours at the best number of worlds, highway-env's), decisions a second."""
    rates = [each["decisions_per_second"] for each in world["lanewise"].values()]
    return max(rates), world["highway_env"]["decisions_per_second"]


def _readings(study: Any) -> str:
    """The literal readings beside the default."""
    lines = [
        "",
        "## Which readings carry the claim",
        "",
        f"`{study['command']}` ({study['date'][:10]}).",
        "Each arm changes the default in the settings named, all else equal; means over seeds",
        "of 300 test episodes, success seed by seed. Arms that differ in step 2 or in tests",
        "alone take over step 1 of the default's run.",
        "",
        "| reading | settings | success of each seed | " + " | ".join(c[1] for c in COLUMNS) + " |",
        "|---|---|---|" + "---:|" * len(COLUMNS),
    ]
    for arm in dict.fromkeys(row["arm"] for row in study["rows"]):
        rows = [row for row in study["rows"] if row["arm"] == arm]
        flags = ((name.replace("_", "-"), value) for name, value in rows[0]["changes"].items())
        changes = ", ".join(f"`--{name} {value}`" for name, value in flags)
        seeds = ", ".join(f"{100 * row['lanewise']['success_rate']:.1f}" for row in rows)
        figures = _line("", [row["lanewise"] for row in rows]).removeprefix("|  |")
        lines.append(f"| {arm} | {changes} | {seeds} |{figures}")
    return "\n".join(lines) + "\n"


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
