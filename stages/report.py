"""Stage `report`: the table of results and artifacts → markdown, SVGs and one HTML page."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.evaluation import results
from pipeline.report import report, sweep
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from pipeline.sweeps.record import Record
from stages import ROOT, build, stage


@stage("report")
def main(cfg: DictConfig) -> str:
    layout = Layout(Path(cfg.artifacts))
    known_studies = studies(ROOT / "conf")
    table = results.read(layout, known_studies)
    with store.replace(cfg.out) as folder:
        line = report.write(
            folder, layout, known_studies, table, cfg.few, lambda name: build("view", name)
        )
    return f"{line}; open {cfg.out}/page.html in a browser, it needs no network"


def sweep_report(
    folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]
) -> str:
    """Write the table and the figure of a sweep into its folder.

    Returns the table for a terminal.
    """
    return sweep.write(folder, records, usual_overrides)


if __name__ == "__main__":
    main()
