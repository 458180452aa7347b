"""Stage `report`: the tables of results and artifacts → markdown, SVGs and one HTML page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.core import store
from pipeline.core.settings import Count
from pipeline.evaluation import results
from pipeline.report import report, sweep
from pipeline.studies import measured
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study
from pipeline.sweeps.record import Record
from stages import build, stage


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/report.yaml."""

    studies: tuple[Study, ...]
    """As conf/studies.yaml has them; the numbers are of those that were measured."""
    artifacts: Path
    few: Count
    """Fewer seen queries than this near a real change say little."""
    out: Path


@stage("report")
def main(settings: Settings) -> str:
    layout = Layout(settings.artifacts)
    named = {study.name: study for study in settings.studies}
    studies = {name: measured.read(layout, name) for name in named}
    table = results.read(layout, studies)
    stale = measured.stale(layout, named)
    with store.replace(settings.out) as folder:
        line = report.write(
            folder, layout, studies, table, settings.few, lambda name: build("view", name), stale
        )
    return f"{line}; open {settings.out}/page.html in a browser, it needs no network"


def sweep_report(
    folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]
) -> str:
    """Write the table and the figure of a sweep into its folder.

    Returns the table for a terminal.
    """
    return sweep.write(folder, records, usual_overrides)


if __name__ == "__main__":
    main()
