"""Kept and last weights side by side, as a Markdown table."""

from collections.abc import Mapping, Sequence

from lanewise.report.escape import cell
from lanewise.report.table import spread
from lanewise.runs.selected_weights import SelectedWeights

SHOWN = (
    ("escape_rate", "success (paper), %", 100.0, 1),
    ("success_rate", "success, %", 100.0, 1),
    ("accident_rate", "accidents, %", 100.0, 1),
    ("reward", "reward, 1 a second", 1.0, 2),
)
"""Figure of the metrics, title, factor, digits."""
HEADS = (
    *("stage", "kept by", "chosen for success, %"),
    *(f"{title}: {of}" for _, title, _, _ in SHOWN for of in ("kept", "last")),
)


def table(stages: Mapping[str, Sequence[SelectedWeights]]) -> str:
    """A row a stage: means over seeds, the lowest and the highest in parentheses.

    Args:
        stages: by title, what each seed kept.
    """
    lines = ["| " + " | ".join(HEADS) + " |", "|---|---|" + "---:|" * (len(HEADS) - 2)]
    for title, seeds in stages.items():
        chosen = [100.0 * each for seed in seeds if (each := seed.chosen_for) is not None]
        cells = [cell(title), cell(seeds[0].line["rule"]), spread(chosen, 1)]
        for name, _, factor, digits in SHOWN:
            for of in ("kept", "last"):
                cells.append(spread([factor * seed.line[f"{of}_{name}"] for seed in seeds], digits))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
