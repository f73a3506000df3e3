"""What the figures of one run say about one another: how many times as fast as which peer."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from lanewise.bench.parts import evaluation, latency, level, start_up, training, update, world
from lanewise.bench.task import Figure

OURS = "lanewise"


@dataclass(frozen=True)
class Ratio:
    """A comparison, in words and as a number."""

    what: str
    value: float
    unit: str
    """`times`, or the unit of a figure that needs no peer."""
    how: str
    """Which figures it comes from."""


def of(figures: Sequence[Figure], cores: int) -> list[Ratio]:
    """Every comparison that the figures allow.

    Args:
        figures: of one run.
        cores: that were used.
    """
    return [
        *_worlds(figures, cores),
        *_latencies(figures),
        *_updates(figures),
        *_level(figures, cores),
        *_commands(figures),
    ]


def _worlds(figures: Sequence[Figure], cores: int) -> list[Ratio]:
    """Our best number of worlds against each peer with the same vehicles and cores."""
    found = []
    for case in _cases(figures, world.PART):
        ours = _best(figures, world.PART, case, OURS)
        for peer in ("EnvPool", "highway-env"):
            theirs = _best(figures, world.PART, case, peer)
            if ours and theirs:
                found.append(_times(f"world, {case}, against {peer}", ours, theirs))
        alone = _best(figures, world.PART, case.replace(f"{cores} cores", "1 core"), "highway-env")
        if ours and alone and cores > 1 and case.endswith(f"{cores} cores"):
            what = f"world, {case}, against one highway-env"
            found.append(_times(what, ours, alone))
    return found


def _latencies(figures: Sequence[Figure]) -> list[Ratio]:
    found = []
    for case in _cases(figures, latency.PART):
        ours = _best(figures, latency.PART, case, OURS)
        theirs = _best(figures, latency.PART, case, "highway-env")
        if ours and theirs:
            how = f"{theirs.value:,.0f} / {ours.value:,.0f} {ours.unit}"
            what = f"one decision of one world, {case}, against highway-env"
            found.append(Ratio(what, theirs.value / ours.value, "times", how))
    return found


def _updates(figures: Sequence[Figure]) -> list[Ratio]:
    """Against the fastest of PyTorch's, and as a share of the fastest matrix product measured."""
    found = []
    for case in _cases(figures, update.PART):
        ours = _best(figures, update.PART, case, OURS)
        if ours is None:
            continue
        for peer in ("PyTorch, double DQN", "Stable-Baselines3, DQN"):
            theirs = _best(figures, update.PART, case, peer)
            if theirs:
                found.append(_times(f"update, {case}, against {peer}", ours, theirs))
        product = _best(figures, update.PART, case, "matrix product")
        if product:
            done = ours.detail["gflop_per_second"]
            found.append(
                Ratio(
                    f"update, {case}, of the matrix product's rate",
                    100 * done / product.value,
                    "%",
                    f"{done:,.0f} / {product.value:,.0f} {product.unit} ({product.subject})",
                )
            )
    return found


def _level(figures: Sequence[Figure], cores: int) -> list[Ratio]:
    times = [
        figure.value for figure in figures if (figure.part, figure.case) == (level.PART, level.CASE)
    ]
    if not times:
        return []
    typical = median(times)
    found = [
        Ratio(
            "a hierarchical controller at the paper's level",
            typical,
            "s",
            f"median of {len(times)} seeds, {min(times):.0f} to {max(times):.0f} s",
        )
    ]
    sb3 = next(
        (
            figure
            for figure in figures
            if figure.subject == training.SUBJECT_SB3 and figure.case == training.case(False, cores)
        ),
        None,
    )
    if sb3:
        found.append(
            Ratio(
                "steps that Stable-Baselines3's DQN takes on highway-env in that time",
                typical * sb3.value,
                "steps",
                f"{typical:.0f} s x {sb3.value:.1f} {sb3.unit}",
            )
        )
    return found


def _commands(figures: Sequence[Figure]) -> list[Ratio]:
    wanted = {(start_up.PART, "lanewise --help"), (evaluation.PART, "lanewise")}
    return [
        Ratio(figure.case, figure.value, figure.unit, figure.part)
        for figure in figures
        if (figure.part, figure.subject) in wanted
    ]


def _cases(figures: Sequence[Figure], part: str) -> list[str]:
    return list(dict.fromkeys(figure.case for figure in figures if figure.part == part))


def _best(figures: Sequence[Figure], part: str, case: str, subject: str) -> Figure | None:
    """The largest figure of a subject, whose name begins so."""
    found = [
        figure
        for figure in figures
        if (figure.part, figure.case) == (part, case) and figure.subject.startswith(subject)
    ]
    return max(found, key=lambda figure: figure.value, default=None)


def _times(what: str, ours: Figure, theirs: Figure) -> Ratio:
    who = f"{ours.subject} / {theirs.subject}"
    how = f"{ours.value:,.0f} / {theirs.value:,.0f} {ours.unit} ({who})"
    return Ratio(what, ours.value / theirs.value, "times", how)
