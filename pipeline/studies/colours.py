"""A colour and a marker for each method, in every figure; the colour in MLflow too."""

import hashlib

PALETTE = (
    "#004087",
    "#BF4000",
    "#006840",
    "#B74080",
    "#1878C7",
    "#9F6840",
    "#8F3897",
    "#603800",
    "#202020",
)
"""Found by search: any two are at least 20 apart (CIE 1976 ΔE) to a reader with deuteranopia as
Machado, Oliveira and Fernandes (2009) simulate it, and each has a contrast of 4.5 or more against
white, as text needs (tested)."""
MARKERS = ("o", "v", "D", "P", "s", "^", "X", "<", "d")
"""Of matplotlib, in the same order."""


def method_of(model: str) -> str:
    """The method of a model: `sci` of `sci-4way`."""
    return model.partition("-")[0]


def colour(model: str) -> str:
    """The colour of a model's method in all figures and in MLflow, from the name alone.

    So no list of names is needed. The salt is chosen so that the methods of the two papers and
    `scan_context_all` have different colours (tested), and related ones similar colours: two blues
    for SCI's, orange and vermilion for Scan Context's.
    """
    return PALETTE[_place(model)]


def darker(tint: str) -> str:
    """A colour #rrggbb with two fifths of its light, for a variant beside its method."""
    return "#" + "".join(f"{int(tint[i : i + 2], 16) * 2 // 5:02X}" for i in (1, 3, 5))


def marker(model: str) -> str:
    """The marker of a model's method, which goes with its colour."""
    return MARKERS[_place(model)]


def _place(model: str) -> int:
    digest = hashlib.sha256(f"147890{method_of(model)}".encode()).digest()
    return int.from_bytes(digest[:8], "big") % len(PALETTE)
