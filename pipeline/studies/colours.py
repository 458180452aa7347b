"""Gives each method a colour and a marker, the same in every figure and in MLflow."""

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
"""Nine colours that were found by search.

Any two are at least 20 apart (CIE 1976 ΔE) to a reader with deuteranopia as Machado, Oliveira and
Fernandes (2009) simulate it, and each has the contrast of 4.5 against white that text needs. A test
checks both.
"""
MARKERS = ("o", "v", "D", "P", "s", "^", "X", "<", "d")
"""Markers of matplotlib, in the order of the colours that they go with."""


def method_of(model: str) -> str:
    """The method of a model: `sci` of `sci-4way`."""
    return model.partition("-")[0]


def colour(model: str) -> str:
    """The colour of a model's method, #rrggbb; it follows from the name, so no list is needed."""
    return PALETTE[_index(model)]


def darker(tint: str) -> str:
    """A colour #rrggbb with two fifths of its light, for a variant beside its method."""
    red, green, blue = (int(tint[start : start + 2], 16) for start in (1, 3, 5))
    return f"#{red * 2 // 5:02X}{green * 2 // 5:02X}{blue * 2 // 5:02X}"


def marker(model: str) -> str:
    """The marker of a model's method, which goes with its colour."""
    return MARKERS[_index(model)]


SALT = "147890"
"""A number that was chosen so that the methods of both papers get different colours (tested).

Related methods get similar ones: two blues for SCI's, orange and vermilion for Scan Context's.
"""


def _index(model: str) -> int:
    """The index of a method's colour and marker, by a hash of its name."""
    digest = hashlib.sha256(f"{SALT}{method_of(model)}".encode()).digest()
    return int.from_bytes(digest[:8], "big") % len(PALETTE)
