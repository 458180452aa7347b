"""What the two papers claim, as comparisons of numbers in tables of our own results.

CLAIMS lists the findings of paper 1 (Kim, Park and Kim: SCI) and paper 2 (Yin et al.: PFL). Each
has a name, under which templates/words.yaml has its words, and a comparison from `judging` that
says whether our numbers show it. A side of a comparison (`judging.Side`) is one number of one model
in one of the tables that docs/papers keeps:

- `nway`: SCI trained in full, with N headings of each view;
- `street`: methods on bird-views of a street;
- `compare`: all methods;
- `real`: recordings.
"""

from dataclasses import dataclass, replace

from benchmarks.papers.judging import (
    BLACK_ERROR,
    KEPT_WHOLE,
    Measure,
    Side,
    ascend,
    at_every_heading,
    has_no_verdict,
    is_ahead,
    is_below,
    is_not_measured,
    keeps_less,
    spreads_less,
)
from pipeline.evaluation.rows import HEADING, NOVELTY, PERTURBED, VIEWPOINT

HALF = 0.5
CODES_OF_A_PLACE = 8
"""One for each heading."""
PLACE_CODE_B = 1.05 * 1024
"""Bytes of a code: the paper's 1 KB, and 5 % for what else is stored of a place."""
SCAN_MS = 100.0
"""Time between two scans at 10 Hz."""
DESCRIPTORS = ("scan_context", "m2dp", "pointnetvlad")
"""The methods that paper 1 compares SCI with."""


@dataclass(frozen=True)
class Claim:
    """A finding of a paper, and how the tables judge it."""

    name: str
    """Its name in templates/words.yaml."""
    paper: int
    """1 or 2."""
    measure: Measure
    """Judges it by the tables."""
    digits: int = 3
    """Decimals of its numbers on the page."""


# The sides: table, study and method, then what differs from the defaults of `Side`.
SCI_IN_FULL = Side("nway", "campus", "sci")
SCI_ENTROPY = replace(SCI_IN_FULL, number="auroc", ask=NOVELTY, of="entropy")
SCI_CUT_SHORT = Side("compare", "campus", "sci")
CAMPUS_DESCRIPTORS = tuple(Side("compare", "campus", method) for method in DESCRIPTORS)
TOWN_DESCRIPTORS = tuple(Side("compare", "town", method) for method in DESCRIPTORS)
RECORDED_DESCRIPTORS = tuple(Side("real", "nclt_keyframes", method) for method in DESCRIPTORS)
SCAN_CONTEXT, M2DP, POINTNETVLAD = CAMPUS_DESCRIPTORS
SCI_4_WAY, SCI_4_WAY_200 = (
    replace(SCI_IN_FULL, variant=variant) for variant in ("4way", "4way200")
)
SCI_8_WAY, SCI_8_WAY_200 = (
    replace(SCI_IN_FULL, variant=variant) for variant in ("8way", "8way200")
)
SCI_1_WAY, SCI_1_WAY_200 = (
    replace(SCI_IN_FULL, variant=variant) for variant in ("1way", "1way200")
)
PFL, AFL, SAD = (
    Side(
        "street",
        "suburb",
        method,
        number="accuracy",
        protocol="distance",
        ask=VIEWPOINT,
        of=HEADING,
        at=None,
    )
    for method in ("pfl", "afl", "sad")
)
PFL_ROC, AFL_ROC, SAD_ROC = (replace(side, number="roc_auc") for side in (PFL, AFL, SAD))
PFL_ERROR, AFL_ERROR = (
    replace(side, number="validation_error", protocol="", of="", at=0.0) for side in (PFL, AFL)
)
BLACK_IMAGE = replace(PFL_ERROR, number=BLACK_ERROR)
SCI_MS, M2DP_MS, POINTNETVLAD_MS, SCAN_CONTEXT_MS, PFL_MS = (
    Side("compare", "campus", method, number="query_ms", protocol="")
    for method in ("sci", "m2dp", "pointnetvlad", "scan_context", "pfl")
)


def with_random_turns(side: Side) -> Side:
    """The same number, with queries that are turned at random."""
    return replace(side, ask=PERTURBED, of="turned")


def with_number(number: str, *sides: Side) -> tuple[Side, ...]:
    """The same models with another number."""
    return tuple(replace(side, number=number) for side in sides)


def four_way_claims(four: Side, eight: Side, single: Side, suffix: str) -> tuple[Claim, ...]:
    """Four headings in training against eight on turned queries, and against one unperturbed.

    `suffix` is the end of the claims' names.
    """
    turned = [with_random_turns(side) for side in (four, eight)]
    return (
        Claim(f"four_suffice{suffix}", 1, is_ahead(*turned, factor=KEPT_WHOLE)),
        Claim(f"four_cost_nothing{suffix}", 1, is_ahead(four, single, factor=KEPT_WHOLE)),
    )


CLAIMS = (
    Claim("nclt", 1, is_ahead(SCI_IN_FULL, *CAMPUS_DESCRIPTORS)),
    Claim(
        "nclt_recorded", 1, is_ahead(Side("real", "nclt_keyframes", "sci"), *RECORDED_DESCRIPTORS)
    ),
    Claim("oxford", 1, is_ahead(Side("compare", "town", "sci"), *TOWN_DESCRIPTORS)),
    Claim(
        "loses_less_over_the_year",
        1,
        is_ahead(*with_number("auc_top1_per_100_days", SCI_IN_FULL, SCAN_CONTEXT), noise=0.0),
    ),
    Claim(
        "top1_against_25", 1, is_ahead(SCI_IN_FULL, *with_number("auc_top25", *CAMPUS_DESCRIPTORS))
    ),
    Claim("entropy", 1, is_ahead(SCI_ENTROPY, *with_number("auroc", *CAMPUS_DESCRIPTORS))),
    Claim("entropy_own", 1, is_ahead(SCI_ENTROPY, replace(SCI_ENTROPY, of="feature_distance"))),
    Claim("half_circle", 1, is_ahead(SCAN_CONTEXT, TOWN_DESCRIPTORS[0])),
    Claim(
        "m2dp_walls",
        1,
        is_ahead(replace(M2DP, ask=PERTURBED, of="construction", at=2.0), M2DP, factor=KEPT_WHOLE),
    ),
    Claim(
        "m2dp_wedge",
        1,
        has_no_verdict(
            replace(M2DP, ask=PERTURBED, of="demolition", at=60.0), M2DP, factor=KEPT_WHOLE
        ),
    ),
    Claim(
        "scan_context_turned",
        1,
        keeps_less(with_random_turns(SCAN_CONTEXT), SCAN_CONTEXT),
    ),
    Claim("m2dp_turned", 1, keeps_less(with_random_turns(M2DP), M2DP)),
    *four_way_claims(SCI_4_WAY, SCI_8_WAY, SCI_1_WAY, ""),
    *four_way_claims(SCI_4_WAY_200, SCI_8_WAY_200, SCI_1_WAY_200, "_200"),
    Claim("jet", 1, is_ahead(SCI_IN_FULL, replace(SCI_IN_FULL, variant="grey"))),
    Claim("small_cells", 1, is_ahead(replace(SCI_IN_FULL, grid="5m"), POINTNETVLAD)),
    # Table III, the fastest first
    Claim("times", 1, ascend(SCI_MS, M2DP_MS, POINTNETVLAD_MS, SCAN_CONTEXT_MS), digits=1),
    Claim("trained_in_full", 1, is_ahead(SCI_IN_FULL, SCI_CUT_SHORT)),
    Claim("pfl_accuracy", 2, at_every_heading(PFL, AFL)),
    Claim("pfl_roc", 2, at_every_heading(PFL_ROC, AFL_ROC)),
    Claim(
        "pfl_logistic",
        2,
        at_every_heading(replace(PFL, variant="logistic"), replace(AFL, variant="logistic")),
    ),
    Claim(
        "as_written",
        2,
        at_every_heading(replace(PFL, variant="paper"), replace(AFL, variant="logistic")),
    ),
    Claim("pfl_learns", 2, at_every_heading(PFL, replace(PFL, variant="untrained"))),
    Claim("afl_accuracy", 2, at_every_heading(AFL, SAD)),
    Claim("afl_roc", 2, at_every_heading(AFL_ROC, SAD_ROC)),
    Claim("sad_near", 2, at_every_heading(SAD, None, within_deg=30.0, limit=HALF)),
    Claim("sad_beyond", 2, at_every_heading(SAD, None, sign=-1, beyond_deg=30.0, limit=HALF)),
    Claim("sad_eight", 2, at_every_heading(PFL, replace(SAD, variant="eight_headings"))),
    Claim("nclt_easier", 2, is_not_measured),
    Claim("reconstruction", 2, at_every_heading(PFL_ERROR, AFL_ERROR, sign=-1)),
    Claim("black_image", 2, at_every_heading(PFL_ERROR, BLACK_IMAGE, sign=-1)),
    Claim("one_heading", 2, at_every_heading(PFL, replace(PFL, variant="one_heading"))),
    Claim("stable", 2, spreads_less(PFL, AFL)),
    Claim("ten_hertz", 2, is_below(PFL_MS, SCAN_MS), digits=1),
    Claim(
        "one_kb",
        2,
        is_below(
            replace(PFL, number="bytes_per_place", of="", at=0.0),
            PLACE_CODE_B,
            factor=1 / CODES_OF_A_PLACE,
        ),
        digits=0,
    ),
)
