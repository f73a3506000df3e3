"""What the figures of one run say about one another: how many times as fast as which peer."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from lanewise.bench.measurement import Measurement, number
from lanewise.bench.suite import training_case

OURS = "lanewise"
SB3_TRAINING = "Stable-Baselines3, DQN on highway-env"
LEVEL = "lanewise train hierarchical --preset quick"
LEVEL_CACHED = f"{LEVEL}, JAX_COMPILATION_CACHE_DIR set, second time"


@dataclass(frozen=True)
class Ratio:
    """A comparison, in words and as a number."""

    what: str
    value: float
    unit: str
    """`times`, or the unit of a figure that needs no peer."""
    how: str
    """Which figures it comes from."""


def of(figures: Sequence[Measurement], cores: int) -> list[Ratio]:
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


def _worlds(figures: Sequence[Measurement], cores: int) -> list[Ratio]:
    """Our best number of worlds against each peer with the same vehicles and cores."""
    found = []
    for case in _cases(figures, "world"):
        ours = _best(figures, "world", case, OURS)
        for peer in ("EnvPool", "highway-env"):
            theirs = _best(figures, "world", case, peer)
            if ours and theirs:
                found.append(_times(f"world, {case}, against {peer}", ours, theirs))
        alone = _best(figures, "world", case.replace(f"{cores} cores", "1 core"), "highway-env")
        if ours and alone and cores > 1 and case.endswith(f"{cores} cores"):
            what = f"world, {case}, against one highway-env"
            found.append(_times(what, ours, alone))
    return found


def _latencies(figures: Sequence[Measurement]) -> list[Ratio]:
    found = []
    for case in _cases(figures, "latency"):
        ours = _best(figures, "latency", case, OURS)
        theirs = _best(figures, "latency", case, "highway-env")
        if ours and theirs:
            how = f"{theirs.value:,.0f} / {ours.value:,.0f} {ours.unit}"
            what = f"one decision of one world, {case}, against highway-env"
            found.append(Ratio(what, theirs.value / ours.value, "times", how))
    return found


def _updates(figures: Sequence[Measurement]) -> list[Ratio]:
    """Against the fastest of PyTorch's, and as a share of the fastest matrix product measured."""
    found = []
    for case in _cases(figures, "update"):
        ours = _best(figures, "update", case, OURS)
        if ours is None:
            continue
        for peer in ("PyTorch, double DQN", "Stable-Baselines3, DQN"):
            theirs = _best(figures, "update", case, peer)
            if theirs:
                found.append(_times(f"update, {case}, against {peer}", ours, theirs))
        product = _best(figures, "update", case, "matrix product")
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


def _level(figures: Sequence[Measurement], cores: int) -> list[Ratio]:
    times = [each.value for each in figures if (each.part, each.case) == ("level", LEVEL)]
    if not times:
        return []
    typical = median(times)
    how = f"median of {len(times)} seeds, {min(times):.0f} to {max(times):.0f} s"
    found = [Ratio("a hierarchical controller at the paper's level", typical, "s", how)]
    sb3 = _best(figures, "training", training_case(False, cores), SB3_TRAINING)
    if sb3:
        what = "steps that Stable-Baselines3's DQN takes on highway-env in that time"
        how = f"{typical:.0f} s x {sb3.value:.1f} {sb3.unit}"
        found.append(Ratio(what, typical * sb3.value, "steps", how))
    return found


def _commands(figures: Sequence[Measurement]) -> list[Ratio]:
    wanted = {("start-up", "lanewise --help"), ("evaluation", "lanewise")}
    return [
        Ratio(figure.case, figure.value, figure.unit, figure.part)
        for figure in figures
        if (figure.part, figure.subject) in wanted
    ]


def _cases(figures: Sequence[Measurement], part: str) -> list[str]:
    return list(dict.fromkeys(figure.case for figure in figures if figure.part == part))


def _best(figures: Sequence[Measurement], part: str, case: str, subject: str) -> Measurement | None:
    """The largest figure of a subject, whose name begins so."""
    found = [
        figure
        for figure in figures
        if (figure.part, figure.case) == (part, case) and figure.subject.startswith(subject)
    ]
    return max(found, key=lambda figure: figure.value, default=None)


def _times(what: str, ours: Measurement, theirs: Measurement) -> Ratio:
    who = f"{ours.subject} / {theirs.subject}"
    how = f"{ours.value:,.0f} / {theirs.value:,.0f} {ours.unit} ({who})"
    return Ratio(what, ours.value / theirs.value, "times", how)


def table(found: Sequence[Ratio]) -> str:
    """Comparisons for a terminal."""
    width = max((len(ratio.what) for ratio in found), default=0)
    lines = [
        f"  {ratio.what:<{width}} {number(ratio.value):>9} {ratio.unit:<6} {ratio.how}"
        for ratio in found
    ]
    return "\n".join(["", "", "side by side", *lines]) if found else ""
