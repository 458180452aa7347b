"""A colour for each method, in every figure and in MLflow."""

import hashlib

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#3FA7E0", "#D89000", "#7B3294", "#6B4E16", "#1F1F1F")
"""Okabe and Ito's hues, which colour-blind readers can tell apart; the two lightest are darkened, so that text can have them."""


def method_of(model: str) -> str:
    """`sci` of the model `sci-4way`."""
    return model.partition("-")[0]


def colour(model: str) -> str:
    """The colour of a model's method in all figures and in MLflow, from the name alone, so that no list of names is needed.

    The salt is chosen so that the methods of the two papers and `scan_context_all` have different colours (tested), and related
    ones similar colours: two blues for SCI's, orange and vermilion for Scan Context's.
    """
    digest = hashlib.sha256(f"147890{method_of(model)}".encode()).digest()
    return PALETTE[int.from_bytes(digest[:8], "big") % len(PALETTE)]
