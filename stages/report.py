"""Stage `report`: writes the results of all studies as markdown, figures and one HTML page.

It reads the tables of results and the artifacts, and measures nothing itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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
    """The studies of the current conf/studies.yaml; the report shows them as they were measured."""
    artifacts: Path
    few: Count
    """A number of fewer seen queries than this near a real change is marked as weak evidence."""
    out: Path


@stage("report")
def main(settings: Settings) -> str:
    layout = Layout(settings.artifacts)
    current_studies = {study.name: study for study in settings.studies}
    measured_studies = {name: measured.read(layout, name) for name in current_studies}
    table = results.read(layout, measured_studies)
    stale = measured.stale(layout, current_studies)
    with store.replace(settings.out) as folder:
        line = report.write(
            folder,
            layout,
            measured_studies,
            table,
            least_queries=settings.few,
            view=partial(build, "view"),
            stale=stale,
        )
    return f"{line}; open {settings.out}/page.html in a browser, it needs no network"


def sweep_report(
    folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]
) -> str:
    """Write the table and the figure of a sweep into its folder; returns the table as text."""
    return sweep.write(folder, records, usual_overrides)


if __name__ == "__main__":
    main()
