"""The papers' Table II, the results by each protocol and the kinds of novelty."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports.result import Result, by_method, by_sequence, dates
from pipeline.reports.table import MISSING, Table, bracket, mean, number, spread

OTHERS = (
    ("AUC exact", "auc_exact_top1", 3),
    ("F1max", "f1_max", 3),
    ("R@99%P", "recall_at_99_precision", 3),
    ("AUROC", "auroc", 3),
    ("precision", "precision_at_threshold", 3),
    ("recall", "recall_at_threshold", 3),
    ("error [m]", "median_error_m", 1),
)
"""Heading, key in the metrics, digits after the point: the numbers that no interval is shown of."""
HEADINGS = (("heading error [°]", "median_heading_error_deg", 1), ("within 10°", "heading_within_10deg", 3))
MAIN = {"recall_at_1": ("recall@1", "oracle"), "auc_top1": ("AUC top-1", "oracle_auc_exact_top1")}
"""Number of the methods: its heading, and the oracle's number beside it."""
CELLS = ("cells: seen", "unseen", "share unseen")
DISTANCE = ("distance: seen", "unseen", "not judged")
KINDS = (
    ("AUROC", "auroc"),
    ("AUC exact", "auc_exact_top1"),
    ("R@99%P", "recall_at_99_precision"),
    ("precision", "precision_at_threshold"),
    ("recall", "recall_at_threshold"),
)
"""Heading and measure of a kind of novelty."""
Marks = Mapping[tuple[str, str, str, str], str]
"""Method, sequence, protocol and number to `+` or `−`: surely better or worse than the first method."""
Shown = Callable[[Result], str]


def sequences(results: Sequence[Result]) -> Table:
    """Table II of the SCI paper: each test sequence's age, and how much of it lies where training went, by both protocols."""
    rows = []
    for name, group in by_sequence(results).items():
        n, queries = group[0].numbers, int(group[0].numbers["queries"])
        (seen, unseen), (near, far) = ((n[protocol]["seen"], n[protocol]["unseen"]) for protocol in PROTOCOLS)
        counts = (n["days"], queries, seen, unseen)
        share = number(unseen / queries if queries else None, 3)
        rows.append((name, *map(str, counts), share, *map(str, (near, far, queries - near - far))))
    header = ("sequence", "days", "queries", *CELLS, *DISTANCE)
    return Table(header, tuple(rows), words=1)


def main(results: Sequence[Result], protocol: str, key: str, marks: Marks) -> Table:
    """One number of MAIN by one protocol, a row a test sequence and a column a method, with intervals; the oracle's last."""
    (heading, oracle), methods = MAIN[key], by_method(results)
    days, width = dates(results), len("0.792 [.76, .83]")

    def entry(result: Result) -> str:
        mark = marks.get((result.method, result.sequence, protocol, key), "")
        told = number(result.number(protocol, key), 3) + bracket(result.interval(protocol, key), 3)
        return f"{told.ljust(width)} {mark:1}" if result.method in marked else told.ljust(width)

    marked = {method for method, *_ in marks}
    rows = []
    for name, group in by_sequence(results).items():
        rows.append((days[name], *map(entry, group), number(group[0].number(protocol, oracle), 3)))
    if len(rows) > 1:
        means = [
            spread([r.number(protocol, key) for r in group], 3).ljust(width + 2 * (method in marked))
            for method, group in methods.items()
        ]
        firsts = [group[0].number(protocol, oracle) for group in by_sequence(results).values()]
        rows.append(("mean", *means, number(mean(firsts), 3)))
    return Table((heading, *methods, "oracle" if key == "recall_at_1" else "oracle, exact"), tuple(rows), words=1)


def means(results: Sequence[Result]) -> Table:
    """The other numbers of each method by both protocols: means over the test sequences."""
    told = by_method([result for result in results if tells_heading(result)])
    shown = (*OTHERS, *(HEADINGS if told else ()))
    rows = [
        (method, protocol, *(number(mean([r.number(protocol, key) for r in group]), digits) for _, key, digits in shown))
        for protocol in PROTOCOLS
        for method, group in by_method(results).items()
    ]
    return Table(("mean", "by", *(heading for heading, *_ in shown)), tuple(rows), words=2)


def everything(results: Sequence[Result], protocol: str) -> Table:
    """The numbers of each sequence and method by one protocol, without intervals."""
    shown = (("recall@1", "recall_at_1", 3), ("oracle", "oracle", 3), ("AUC top-1", "auc_top1", 3), *OTHERS)
    rows = [
        (name, result.method, *(number(result.number(protocol, key), digits) for _, key, digits in shown))
        for name, group in by_sequence(results).items()
        for result in group
    ]
    return Table(("sequence", "method", *(heading for heading, *_ in shown)), tuple(rows), words=2)


def headings(results: Sequence[Result]) -> Table | None:
    """How well headings were told, by both protocols; None where no method tells one."""
    told = [result for result in results if tells_heading(result)]
    if not told:
        return None
    rows = []
    columns = [
        (f"{heading}, by {protocol}", protocol, key, digits) for protocol in PROTOCOLS for heading, key, digits in HEADINGS
    ]
    for method, group in by_method(told).items():
        for r in group:
            cells = [number(r.number(p, key), digits) + bracket(r.interval(p, key), digits) for _, p, key, digits in columns]
            rows.append((method, r.sequence, *cells))
        if len(group) > 1:
            rows.append((method, "mean", *(spread([r.number(p, key) for r in group], digits) for _, p, key, digits in columns)))
    return Table(("method", "sequence", *(heading for heading, *_ in columns)), tuple(rows), words=2)


def tells_heading(result: Result) -> bool:
    """Whether its method told the heading of any query."""
    return bool(np.isfinite(result.evaluation.heading_error_deg).any())


def novelties(results: Sequence[Result], protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means over the test sequences, and the sequence it does worst in."""
    rows = []
    for method, group in by_method(results).items():
        for k, kind in enumerate(group[0].evaluation.kinds):
            values = np.stack([r.evaluation.protocol(protocol).rejection[k, :, 0] for r in group])  # (sequence, measure)
            averages = [mean(list(values[:, MEASURES.index(measure)])) for _, measure in KINDS]
            auroc = values[:, MEASURES.index("auroc")]
            worst = MISSING
            if np.isfinite(auroc).any():
                at = int(np.nanargmin(auroc))
                worst = f"{auroc[at]:.3f} on {group[at].sequence[:10]}"
            rows.append((method, kind + ("" if k else ", in use"), *(number(value, 3) for value in averages), worst))
    return Table(("method", "novelty", *(heading for heading, _ in KINDS), "worst AUROC"), tuple(rows), words=2)
