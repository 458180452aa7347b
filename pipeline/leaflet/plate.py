"""Figures of the page: each SVG is an image of its own, so that no id in it meets one of another."""

import re
from pathlib import Path
from urllib.parse import quote

from pipeline.errors import ArtifactError
from pipeline.leaflet.markup import Html, inline, join, tag

POINT_PX = 96 / 72
SHOWN = 1.2
"""Times its printed size on a wide screen."""
PLAIN = " !$'()*+,-./:;<=>?@[]^_`{|}~"
"""What a data URL in quotes may hold as it is: the page is a quarter smaller than with base64."""


def plate(svg: Path, title: str, read: str, says: str = "") -> Html:
    """A figure with how to read it and what it says; raises ArtifactError where it is not there."""
    try:
        drawn = svg.read_text()
    except OSError:
        raise ArtifactError(f"{svg}: no such figure; `dvc repro` draws it") from None
    width = re.search(r'<svg[^>]*?\bwidth="([\d.]+)pt"', drawn)
    wide_px = round(float(width[1]) * POINT_PX * SHOWN) if width else 860
    image = tag("img", src=url(drawn), alt=f"{title}. {read}", decoding="async", style=f"--wide: {wide_px}px")
    named = tag("strong", title if title.endswith("?") else f"{title}.")
    caption = tag("figcaption", named, *(join([" ", inline(words)]) for words in (read, says) if words))
    return tag("figure", tag("div", image, class_="scroll", tabindex="0", role="region", aria_label=title), caption)


def url(svg: str) -> str:
    """An SVG as a data URL."""
    return "data:image/svg+xml," + quote(re.sub(r"\s+", " ", svg), safe=PLAIN)
