"""Lists the kinds of artifacts, and generates the data dictionary in docs/artifacts.md from them.

`python -m pipeline.inspection.dictionary` rewrites it; a test checks that it is up to date.
"""

from collections.abc import Iterator
from pathlib import Path

from pipeline.core.schemas import (
    VIEW_KINDS,
    Estimates,
    Fixes,
    Labels,
    Lifelong,
    Maps,
    Rankings,
    Scans,
    Submaps,
    TiledMaps,
    Verdicts,
)
from pipeline.core.store import Artifact
from pipeline.evaluation.evaluations import Evaluations
from pipeline.evaluation.viewpoint_matches import ViewpointMatches

KINDS: dict[str, type[Artifact]] = {
    schema.kind: schema
    for schema in (
        Estimates,
        Scans,
        Submaps,
        *VIEW_KINDS,
        Labels,
        Maps,
        TiledMaps,
        Rankings,
        Verdicts,
        Fixes,
        Evaluations,
        ViewpointMatches,
        Lifelong,
    )
}
"""The class of each kind of artifact that stages write, by its name in their attributes."""
START = "<!-- generated: the kinds of artifacts -->"
"""The line of the page below which all is generated."""


def page(text: str) -> str:
    """The text of the page, with all below START replaced by the tables of today's kinds."""
    head, _, _ = text.partition(START)
    tables = [line for schema in KINDS.values() for line in _section(schema)]
    return "\n".join([head + START, *tables]) + "\n"


def _section(schema: type[Artifact]) -> Iterator[str]:
    """The lines of one kind: a table of its arrays and one of its attributes."""
    yield ""
    yield f"## {schema.kind}, version {schema.version}"
    yield ""
    yield f"{(schema.__doc__ or '').strip().splitlines()[0]}"
    yield ""
    yield "| array | type | dimensions | unit | meaning |"
    yield "|---|---|---|---|---|"
    for name, array in schema.columns.items():
        dims = ", ".join(array.dims)
        yield f"| `{name}` | {array.dtype} | {dims} | {array.unit} | {array.says} |"
    yield ""
    yield "| attribute | meaning |"
    yield "|---|---|"
    for name, meaning in schema.attributes.items():
        yield f"| `{name}` | {meaning} |"


def main() -> None:
    """Rewrite the tables of docs/artifacts.md."""
    path = Path(__file__).parents[2] / "docs/artifacts.md"
    path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
