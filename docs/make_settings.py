"""Writes settings.md, and in other pages all that settings, readings and metrics say.

Run it after changing one of these: ``python docs/make_settings.py``. A test fails until that is
done. Wherever a page quotes a setting as `` `name = value` ``, the value is the default's and is
rewritten here. Between ``<!-- readings -->`` marks stands the table of readings, between
``<!-- rows 13 14 -->`` and ``<!-- /rows -->`` some of its rows, between ``<!-- metrics -->`` marks
what each metric means, between ``<!-- lanes -->`` marks the features of that observation.
"""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any, get_type_hints

from lanewise import config
from lanewise.config.settings import PRESETS, TRAPS, Settings
from lanewise.driving import lane_observation
from lanewise.evaluation.metrics import METRICS
from lanewise.experiments import readings
from lanewise.fields import docstrings
from lanewise.fields.ranges import FieldType
from lanewise.scenario.populations import POPULATIONS, Population
from lanewise.world import build
from lanewise.world.settings import PAPER_DRIVER

DOCS = Path(__file__).parent
PAGES = (DOCS.parent / "README.md", *sorted(DOCS.glob("*.md")))
BEGIN, END = "<!-- readings -->", "<!-- /readings -->"
ROWS = re.compile(r"<!-- rows ([0-9a-c ]+) -->\n.*?<!-- /rows -->", re.DOTALL)
LANE_TABLE = re.compile(r"<!-- lanes -->\n.*?<!-- /lanes -->", re.DOTALL)
METRIC_TABLE = re.compile(r"<!-- metrics -->\n.*?<!-- /metrics -->", re.DOTALL)
QUOTED = re.compile(r"`([a-z_]+(?:\.[a-z_]+)+) = [^`]*`")

INTRODUCTION = """\
# Settings

`python docs/make_settings.py` writes this page from the dataclasses; do not edit it. Defaults are
those of preset `quick` and trap `trap-10`. *Row N* is a row of the table in [paper.md](paper.md).
On the command line a setting is a flag with dashes (`--scenario.trap-speed 9.5`). In a TOML file
it is a name in its section. Every number must be finite and in its range.
"""


def value(setting: Any) -> str:
    """A setting's value as TOML spells it."""
    return json.dumps(setting, allow_nan=False)


def sections(owner: type, prefix: str = "") -> list[str]:
    """A section for each dataclass: its own settings, then the sections below it."""
    docs, defaults = docstrings.of_fields(owner), config.flatten(config.compose())
    rows, below = [], []
    for name, annotation in get_type_hints(owner, include_extras=True).items():
        if dataclasses.is_dataclass(annotation):
            heading = f"## `{prefix}{name}`\n\n{docs[name]}"
            inner = sections(annotation, f"{prefix}{name}.")  # type: ignore[arg-type]
            below += [f"{heading}\n\n{inner[0]}".rstrip(), *inner[1:]]
            continue
        kind, full = FieldType.of(annotation), prefix + name
        allowed = str(kind if kind.bound is None else kind.bound)
        cells = (f"`{full}`", f"`{value(defaults[full])}`", allowed, docs[name])
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    head = ["| setting | default | allowed | meaning |", "|---|---|---|---|"] if rows else []
    return ["\n".join([*head, *rows]), *below]


def presets(title: str, table: dict[str, dict[str, object]]) -> str:
    """What each preset changes in the defaults, as TOML."""
    parts = [f"## {title}"]
    for name, changes in table.items():
        below: dict[str, list[str]] = {}
        for key, change in changes.items():
            section, _, leaf = key.rpartition(".")
            below.setdefault(section, [f"[{section}]"]).append(f"{leaf} = {value(change)}")
        toml = "\n\n".join("\n".join(lines) for lines in below.values())
        parts.append(
            f"**{name}**:\n\n```toml\n{toml}\n```" if toml else f"**{name}**: the defaults."
        )
    return "\n\n".join(parts)


def populations() -> str:
    """Each population of drivers, what it has of its own, and its source."""

    def own(population: Population) -> str:
        fixed = {
            name: (value, value)
            for name in build.NUMBERS
            if name != "target_speed"
            and (value := getattr(population.driver, name)) != getattr(PAPER_DRIVER, name)
        }
        if population.driver.model == "linear":
            gains = vars(population.driver.linear)
            fixed |= {f"linear.{name}": (value, value) for name, value in gains.items()}
        numbers = fixed | dict(population.ranges) | {"desired speed": population.desired_speed}
        if population.waves:
            numbers |= {"wave": population.wave, "period": population.period}
        return ", ".join(
            f"{name} {low:.4g}" + (f" to {high:.4g}" if high != low else "")
            for name, (low, high) in numbers.items()
        )

    rows = [f"| {name} | {own(each)} | {each.source} |" for name, each in POPULATIONS.items()]
    return "\n".join(
        [
            "## Driver populations\n",
            "The names that `scenario.traffic.populations` and `scenario.training_populations`\n"
            "take. Numbers not given are the paper's. Ranges are uniform and drawn for each\n"
            "vehicle. The desired speed and its wave are shares of the traffic's speed.\n",
            "| population | of its own | source |\n|---|---|---|",
            *rows,
        ]
    )


def page() -> str:
    """The whole of settings.md."""
    parts = [INTRODUCTION.rstrip(), *sections(Settings)]
    parts += [presets("Training presets (`--preset`)", PRESETS)]
    parts += [presets("Scenario presets (`--trap`)", TRAPS)]
    parts += [populations()]
    return "\n\n".join(part for part in parts if part) + "\n"


def with_defaults(text: str) -> str:
    """A page with every quoted default up to date."""
    defaults = config.flatten(config.compose())
    return QUOTED.sub(lambda match: f"`{match[1]} = {value(defaults[match[1]])}`", text)


def with_rows(text: str) -> str:
    """A page with its rows of the table of readings up to date, as a list."""
    arms = readings.by_default()

    def listed(match: re.Match[str]) -> str:
        wanted = match[1].split()
        found = {row["number"]: row for row in readings.rows() if row["number"] in wanted}
        lines = [f"- {readings.sentence(found[number], arms)}" for number in wanted]
        where = "[The readings](paper.md#what-the-paper-leaves-open) behind it:"
        body = "\n".join([where, "", *lines])
        return f"<!-- rows {match[1]} -->\n\n{body}\n\n<!-- /rows -->"

    return ROWS.sub(listed, text)


def with_metrics(text: str) -> str:
    """A page with its table of metrics up to date."""
    table = "| metric | unit | meaning |\n|---|---|---|"
    for metric in METRICS:
        unit = "share of 1" if metric.rate else metric.unit
        table += f"\n| `{metric.name}` | {unit} | {metric.meaning} |"
    return METRIC_TABLE.sub(lambda _: f"<!-- metrics -->\n\n{table}\n\n<!-- /metrics -->", text)


def with_lanes(text: str) -> str:
    """A page with its table of the features of observation `lanes` up to date."""
    table = "| feature | unit | divided by | meaning |\n|---|---|---:|---|"
    for feature in lane_observation.FEATURES:
        cells = (feature.name, feature.unit, f"{feature.divisor:g}", feature.meaning)
        table += f"\n| {' | '.join(cells)} |"
    return LANE_TABLE.sub(lambda _: f"<!-- lanes -->\n\n{table}\n\n<!-- /lanes -->", text)


def up_to_date(text: str) -> str:
    """A page with everything up to date that is written here, but the table of readings."""
    return with_lanes(with_metrics(with_rows(with_defaults(text))))


def paper_page() -> str:
    """paper.md with its table of readings."""
    text = (DOCS / "paper.md").read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    table = readings.table(readings.by_default())
    return f"{head}{BEGIN}\n\n{table}\n{END}{rest.split(END)[1]}"


def main() -> None:
    """Writes the pages."""
    (DOCS / "settings.md").write_text(page(), encoding="utf-8")
    (DOCS / "paper.md").write_text(paper_page(), encoding="utf-8")
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        if up_to_date(text) != text:
            path.write_text(up_to_date(text), encoding="utf-8")


if __name__ == "__main__":
    main()
