"""HTML: text is escaped wherever it is put, markup alone is not."""

import json
import re
from collections.abc import Iterable
from html import escape
from typing import Any

VOID = ("img", "meta")
"""Elements that hold nothing."""
UNIT = re.compile(r"(?<=\d) (?=(?:m|MB|d|days?)\b|%)")
"""A blank that no line breaks at."""


class Html(str):
    """Markup. A plain str that is put into a tag is text, and is escaped."""

    __slots__ = ()


def text(content: str) -> Html:
    """Text as markup; markup as it is."""
    return content if isinstance(content, Html) else Html(escape(content))


def join(parts: Iterable[str]) -> Html:
    """One after the other."""
    return Html("".join(map(text, parts)))


def tag(name: str, *content: str, **attributes: object) -> Html:
    """An element; `class_` and `data_key` are the attributes class and data-key, one that is None is left out."""
    told = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"' for key, value in attributes.items() if value is not None
    )
    return Html(f"<{name}{told}>" + ("" if name in VOID else f"{join(content)}</{name}>"))


def data(name: str, value: Any) -> Html:
    """JSON in the page under an id, which no text in it can end early."""
    told = json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")
    return Html(f'<script type="application/json" id="{escape(name)}">{told}</script>')


def prose(words: str) -> Html:
    """The little markdown that the reports' words are written in: paragraphs, lists, **strong**, *emphasis* and `code`."""
    blocks = []
    for block in re.split(r"\n\s*\n", words.strip()):
        first, *items = re.split(r"(?m)^- ", block)
        if first.strip():
            blocks.append(tag("p", inline(first)))
        if items:
            blocks.append(tag("ul", *(tag("li", inline(item)) for item in items)))
    return join(blocks)


def inline(words: str) -> Html:
    """The same within one paragraph."""
    parts = []
    for n, part in enumerate(words.strip().split("`")):
        told = text(part)
        if n % 2:
            parts.append(tag("code", told))
        else:
            told = Html(UNIT.sub("\N{NO-BREAK SPACE}", told))
            told = Html(re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", told, flags=re.DOTALL))
            parts.append(Html(re.sub(r"\*(\S.*?)\*", r"<em>\1</em>", told, flags=re.DOTALL)))
    return join(parts)


def anchor(*words: str) -> str:
    """An id made of words: what is no letter, digit or dash becomes one."""
    return "-".join(re.sub(r"[^0-9A-Za-z]+", "-", word).strip("-") for word in words if word)
