"""Stage `results`: gathers all measured numbers of one study in one table.

It reads the artifacts of the study. It writes the table (one number a row) as a csv, a copy of the
study, and the data of two plots for `dvc plots`. Reports and pages read this table.
"""

from dataclasses import dataclass
from pathlib import Path

from pipeline.core import store
from pipeline.core.settings import Share
from pipeline.evaluation import results
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.events import Bands
from pipeline.evaluation.plots import precision_recall, year
from pipeline.studies import measured as measured_study
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study
from stages import stage


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/results.yaml."""

    study: Study
    artifacts: Path
    unseen_share: Share
    """The expected share of unseen queries, for the AUC on validation blocks."""
    ageing: Ageing
    """Fits lines to numbers over the days since training."""
    bands: Bands
    """Bands of the distance to real changes, by which queries are grouped."""
    out: Path


@stage("results")
def main(settings: Settings) -> str:
    results_table = results.ResultsTable(
        Layout(settings.artifacts),
        settings.study,
        settings.ageing,
        settings.bands,
        settings.unseen_share,
    )
    table = results_table.table()
    with store.replace(settings.out) as folder:
        folder.mkdir()
        table.to_csv(folder / results.FILE, index=False)
        measured_study.write(folder, settings.study)
        year(table).to_csv(folder / "year.csv", index=False, float_format="%.6g")
        precision_recall(results_table).to_csv(
            folder / "precision_recall.csv", index=False, float_format="%.6g"
        )
    models = table.loc[table["method"] != "", ["method", "variant", "seed"]].drop_duplicates()
    return (
        f"{len(table):,} numbers of {len(models)} models on "
        f"{table['sequence'].replace('', None).nunique()} sequences"
    )


if __name__ == "__main__":
    main()
