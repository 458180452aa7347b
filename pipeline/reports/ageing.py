"""The section on ageing: whether methods know their places less well as the days go by, and when to train again."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.ageing import Ageing, Line
from pipeline.evaluation.numbers import SAME_HEADING_DEG
from pipeline.reports import ageing_figures
from pipeline.reports.ageing_lines import DRAWN, MEASURES, ORACLE, PER_DAYS, Aged, HeldOut, Measure, aged
from pipeline.reports.result import Result, by_sequence, some
from pipeline.reports.section import Section, Shown
from pipeline.reports.style import save
from pipeline.reports.table import MISSING, Table, number, signed

FAR = 10
"""Days that are so many times as far as the last sequence are not told."""
READ = {
    "lines": "A row a method. Each dot is a test sequence with its 95 % interval; the shade is the interval of the line, wide"
    f" where few sequences scatter. The number is the slope per {PER_DAYS} days, bold where its interval leaves 0 out.",
    "slopes": "Left of the middle line a number falls with the days. A filled dot is sure, a hollow one not; long bars are cut."
    " The oracle answers with the nearest training pose: what it loses, no method has forgotten.",
}
INTERVALS = (
    "Intervals are of the line through one value a sequence (Student's t), so they hold whatever sets sequences apart, and"
    " say nothing of another year or another place."
)


def section(
    folder: Path,
    name: str,
    results: Sequence[Result],
    known: HeldOut,
    ageing: Ageing,
    simulated: bool,
    sources: Sequence[str],
    parameters: Mapping[str, Any],
) -> Section:
    """Draw ageing.svg and ageing_slopes.svg into `folder` and tell what they show; raises InputError for no results."""
    lines = aged(some(results), known, ageing)
    for stem, draw in (("ageing", ageing_figures.lines), ("ageing_slopes", ageing_figures.slopes)):
        save(draw(lines, simulated), folder / f"{stem}.svg")
    last = max(result.days for result in results)
    return Section(
        name,
        f"Ageing: {last} days after training",
        "Does a method know its places less well as the days since training go by, and when is it time to train again?",
        (*(told(lines, measure, ageing) for measure in DRAWN[:2]), confounded(results), INTERVALS),
        simulated,
        (
            Shown(
                "ageing.svg",
                "Each number over the days since training",
                READ["lines"],
                f"{told(lines, DRAWN[2], ageing)} {newer(lines)}",
            ),
            Shown("ageing_slopes.svg", "How fast each number changes", READ["slopes"], counted(lines, ageing)),
        ),
        tuple((f"{m.title}, per {PER_DAYS} days", table([one for one in lines if one.measure == m], ageing)) for m in MEASURES),
        tuple(sources),
        {**parameters, **{f"ageing.{key}": value for key, value in asdict(ageing).items()}},
    )


def table(lines: Sequence[Aged], ageing: Ageing) -> Table:
    """The lines of one measure, a row a method."""
    rises, rows = lines[0].measure.rises, []
    digits = 1 if rises else 3
    for one in lines:
        cells = [MISSING] * 6
        if line := one.line:
            slopes = (line.slope, *(line.interval or (np.nan, np.nan)), line.middle_slope)
            cells = [number(line.intercept, digits), *(signed(slope * PER_DAYS, digits) for slope in slopes), number(line.p, 3)]
        rows.append((one.method, *cells, MISSING if one.method == ORACLE else verdict(line, one.measure, ageing.loss)))
    header = ("method", "on day 0", "slope", "lowest", "highest", "Theil–Sen", "p")
    return Table((*header, "looks newer" if rises else "train again after [days]"), tuple(rows), words=1)


def verdict(line: Line | None, measure: Measure, loss: float) -> str:
    """`117 [70, 300]` days, ∞ for a bound that is ten times the days tested or more; or why there are none."""
    if line is None or line.interval is None:
        return "too few sequences"
    if measure.rises:
        return {1: "yes", 0: "not shown", -1: "less new"}[line.trend]
    if line.trend > 0:
        return "rises"
    lost = line.lost(loss)
    if lost is None:
        return f"no ageing shown in {line.last_day:g}"
    return _days(lost, line) + (", extrapolated" if lost[0] > line.last_day else "")


def _days(lost: tuple[float, float, float], line: Line) -> str:
    day, first, last = (f"{day:.0f}" if day < FAR * line.last_day else "∞" for day in lost)
    return f"{day} [{first}, {last}]"


def told(lines: Sequence[Aged], measure: Measure, ageing: Ageing) -> str:
    """Which methods surely lose of one number and when to train them again, and which show no ageing."""
    found = {one.method: one.line for one in _methods(lines, measure) if one.line}
    if not found:
        return f"{measure.title}: too few test sequences for an interval."
    last, falls = max(line.last_day for line in found.values()), []
    for method, line in found.items():
        if lost := line.lost(ageing.loss):
            within = "has" if lost[0] <= line.last_day else f"not within the {last:g} days tested, but by extrapolation, has"
            share = f"{ageing.loss:.0%}".replace("%", " %")
            falls.append(
                f"`{method}` {_slope(line)} and {within} lost {share} after {_days(lost, line)} days: train again by then"
            )
    others = {method: line.interval or (np.nan, np.nan) for method, line in found.items() if line.trend >= 0}
    parts = [f"{measure.title}: {'; '.join(falls)}."] if falls else []
    if others:
        worst = min(others, key=lambda method: others[method])
        most = f"{-PER_DAYS * others[worst][0]:.3f} per {PER_DAYS} days (`{worst}`)"
        parts.append(
            f"{'For the others' if falls else f'{measure.title}:'} no ageing is shown within {last:g} days, so nothing says"
            f" retrain; yet a loss of up to {most} cannot be ruled out."
        )
    return " ".join(parts)


def newer(lines: Sequence[Aged]) -> str:
    """To which methods the seen look newer with the days."""
    found = _methods(lines, next(measure for measure in MEASURES if measure.rises))
    sure = [f"`{one.method}` ({_slope(one.line, 1)})" for one in found if one.line and one.line.trend > 0]
    which = (
        f"to {', '.join(sure)}" + ("" if len(sure) == len(found) else ", to the others not surely")
        if sure
        else "to no method, surely"
    )
    return f"Seen places look newer with the days {which}; 50 is as new as the median held-out place of the training day."


def _methods(lines: Sequence[Aged], measure: Measure) -> list[Aged]:
    """Of one number, the methods whose slope has an interval."""
    return [one for one in lines if one.measure == measure and one.method != ORACLE and one.line and one.line.interval]


def _slope(line: Line, digits: int = 3) -> str:
    """`−0.068 [−0.128, −0.008] per 100 days`."""
    slope, low, high = (signed(PER_DAYS * value, digits) for value in (line.slope, *(line.interval or (np.nan, np.nan))))
    return f"{slope} [{low}, {high}] per {PER_DAYS} days"


def confounded(results: Sequence[Result]) -> str:
    """What else differs between the sequences: the share of unseen queries, and of those that drive against training."""
    firsts = [group[0] for group in by_sequence(results).values()]
    days = np.array([result.days for result in firsts], float)
    unseen = np.array([result.evaluation.cells.unseen.mean() for result in firsts])
    turned = np.array([(np.abs(r.evaluation.turn_deg[r.evaluation.cells.seen]) > SAME_HEADING_DEG).mean() for r in firsts])
    return (
        f"Not age alone: unseen queries are {_over(days, unseen)}, which AUC pays for and recall does not; seen queries"
        f" that drive another way than training are {_over(days, turned)}, which the recall in training's heading leaves out."
    )


def _over(days: NDArray[np.float64], shares: NDArray[np.float64]) -> str:
    text = f"{shares[0]:.0%} of the first sequence and {shares[-1]:.0%} of the last".replace("%", " %")
    if len(days) > 2 and shares.std() and days.std():
        text += f" (correlation with the days {signed(float(np.corrcoef(days, shares)[0, 1]), 2)})"
    return text


def counted(lines: Sequence[Aged], ageing: Ageing) -> str:
    """How many of the slopes drawn surely mean ageing, against how many would by chance; and the oracle's."""
    drawn = [one for measure in DRAWN for one in _methods(lines, measure)]
    worse = sum(1 for one in drawn if one.line and one.line.trend == (1 if one.measure.rises else -1))
    chance = len(drawn) * (1 - ageing.level) / 2
    text = f"{worse} of {len(drawn)} slopes surely mean ageing; were there none, about {chance:.1f} would by chance."
    oracle = next(one.line for one in lines if one.method == ORACLE)
    return f"{text} The oracle's recall@1: {_slope(oracle)}." if oracle and oracle.interval else text
