"""Plain data for `dvc plots diff`: csv with a row a point, each naming its method and, where it was, that it is simulated."""

from collections.abc import Iterable, Sequence

from pipeline.reports.result import Result, by_method

YEAR = ("method", "sequence", "days", "auc_top1", "recall_at_1", "recall_at_1_by_distance", "oracle")
CURVE = ("method", "sequence", "threshold", "recall", "precision")


def year(results: Sequence[Result], simulated: bool) -> str:
    """A row a method and test sequence: the days since training and the main numbers, by cells unless named otherwise."""
    shown = (("cells", "auc_top1"), ("cells", "recall_at_1"), ("distance", "recall_at_1"), ("cells", "oracle"))
    return _csv(
        YEAR,
        (
            (_made(r, simulated), r.sequence, r.days, *(r.number(*name) for name in shown))
            for group in by_method(results).values()
            for r in group
        ),
    )


def precision_recall(results: Sequence[Result], simulated: bool) -> str:
    """A row a method, test sequence and threshold of the papers' curve: top-1, by cells."""
    rows = (
        (_made(r, simulated), r.sequence, *point)
        for group in by_method(results).values()
        for r in group
        for point in zip(r.evaluation.thresholds, r.evaluation.cells.recall[0], r.evaluation.cells.precision[0], strict=True)
    )
    return _csv(CURVE, rows)


def _made(result: Result, simulated: bool) -> str:
    return f"{result.method} (simulated)" if simulated else result.method


def _csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Numbers to six digits, so that the noise of a last bit is no difference; nothing for one that is not there."""
    lines = [",".join(header)]
    lines += [",".join("" if v is None else f"{v:.6g}" if isinstance(v, float) else str(v) for v in row) for row in rows]
    return "\n".join(lines) + "\n"
