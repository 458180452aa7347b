"""The precision that is kept for a wanted one, and the words that say so.

A target precision is a share of right poses among the accepted ones. Validation blocks show which
of them a site or a study can keep: it keeps the least of those that is not below a wanted one, or,
if more is wanted, the largest of them.
"""

from collections.abc import Iterable

from pipeline.core.errors import InputError

JUDGED_PRECISION = 0.99
"""The precision that is wanted by default, and at which results and pictures judge poses. Where it
cannot be kept, they judge at the largest one below it that can be."""


def kept_precision(reachable: Iterable[float], wanted: float | None) -> float | None:
    """The precision that is kept for a wanted one: the least reachable one from it on.

    If all reachable precisions are lower, it is the largest of them, which is less than is
    wanted. None if nothing is wanted or none is reachable. Raises InputError unless the wanted one
    is above 0 and at most 1.
    """
    if wanted is None:
        return None
    if not 0 < wanted <= 1:
        raise InputError(
            f"target_precision={wanted:g}: expected a share above 0 and at most 1, such as 0.99"
        )
    ascending = sorted(reachable)
    from_wanted_on = [precision for precision in ascending if precision >= wanted]
    if from_wanted_on:
        return from_wanted_on[0]
    return ascending[-1] if ascending else None


def kept_words(
    who: str, reachable: Iterable[float], wanted: float | None, why: str = ""
) -> str | None:
    """A line that says what is kept instead of a wanted precision; None if that itself is kept.

    `who` keeps it, such as "this site"; `why` says why nothing is kept, if that is known.
    """
    reachable = tuple(reachable)
    kept = kept_precision(reachable, wanted)
    if kept == wanted or wanted is None:
        return None
    if kept is None:
        because = f" ({why})" if why else ""
        return f"{who} can keep no target precision: nothing is accepted{because}"
    if kept > wanted:
        return f"{who} keeps {shown(kept)} for {shown(wanted)}: accepted means {shown(kept)}"
    return f"{who} can keep {shown(kept)}, not {shown(wanted)}: accepted means {shown(kept)}"


def shown(precision: float) -> str:
    """A precision as text, such as .985."""
    return f"{precision:g}".removeprefix("0")
