"""The figures of a run for a terminal."""

from collections.abc import Sequence
from itertools import groupby

from lanewise.bench.ratios import Ratio
from lanewise.bench.task import Figure

MEBIBYTE = 2**20


def text(figures: Sequence[Figure], ratios: Sequence[Ratio]) -> str:
    """Figures by part and case, then what they say about one another."""
    lines = []
    for (part, case), group in groupby(figures, key=lambda figure: (figure.part, figure.case)):
        lines += ["", f"{part}: {case}"]
        for figure in group:
            line = f"  {figure.subject:<40} {number(figure.value):>12} {figure.unit}"
            besides = ", ".join(extras(figure))
            lines.append(f"{line}  ({besides})" if besides else line)
    if ratios:
        width = max(len(ratio.what) for ratio in ratios)
        lines += ["", "side by side"]
        lines += [
            f"  {ratio.what:<{width}} {number(ratio.value):>9} {ratio.unit:<6} {ratio.how}"
            for ratio in ratios
        ]
    return "\n".join(lines).lstrip("\n")


def number(value: float) -> str:
    """A figure with as many digits as mean something."""
    return f"{value:,.2f}" if value < 10 else f"{value:,.1f}" if value < 100 else f"{value:,.0f}"


def extras(figure: Figure) -> list[str]:
    """The few details people look for; the file has all."""
    detail, found = figure.detail, []
    if "decisions_per_second" in detail:
        found.append(f"{detail['decisions_per_second']:,.0f} decisions/s")
    if "ended" in detail and "episodes" in detail:
        crashed = 1 - detail["ended"].get("truncated", 0.0)
        found.append(f"{crashed:.0%} of episodes end by accident")
    if "gflop_per_second" in detail:
        found.append(f"{detail['gflop_per_second']:,.0f} GFLOP/s")
    if "milliseconds_a_step" in detail:
        found.append(
            " + ".join(f"{name} {ms:.2f}" for name, ms in detail["milliseconds_a_step"].items())
            + " ms a step"
        )
    if "seconds_of" in detail:
        found.append(
            " + ".join(f"{name} {seconds:.0f}" for name, seconds in detail["seconds_of"].items())
            + " s"
        )
    if "success_rate" in detail.get("test", {}):
        found.append(f"success {detail['test']['success_rate']:.1%}")
    if "compile_seconds" in detail and "seconds_of" not in detail:
        found.append(f"compiled in {detail['compile_seconds']:.1f} s")
    if "peak_memory_bytes" in detail:
        found.append(f"{detail['peak_memory_bytes'] / MEBIBYTE:,.0f} MiB")
    return found
