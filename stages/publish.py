"""Stage `publish`: shows a study in MLflow, from its table of results, models and figures.

Everything that MLflow shows is in the artifacts already, so its database may be deleted and
published again at any time.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.core import store
from pipeline.evaluation import results
from pipeline.evaluation.rows import pick
from pipeline.running.dvc_files import DvcLock
from pipeline.studies import measured
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import LIFELONG, StudyMethod
from pipeline.tracking import page
from pipeline.tracking import runs as tracking
from pipeline.tracking.records import StudyRuns, of_strategies, stage_costs
from pipeline.tracking.served import Served
from stages import stage


@dataclass(frozen=True)
class Tracking:
    """Where MLflow keeps its runs, and where it is served: a file of conf/tracking."""

    host: str
    port: int
    database: str
    artifacts: str = ""
    """Where MLflow keeps figures and models; if empty, beside the database."""


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/publish.yaml."""

    study: str
    artifacts: Path
    tracking: Tracking


@stage("publish")
def main(settings: Settings) -> str:
    layout = Layout(settings.artifacts)
    study = measured.read(layout, settings.study)
    table = results.read(layout, {study.name: study})
    lock = DvcLock.read(layout.root.parent / "dvc.lock")
    runs = list[tracking.RunRecord]()
    for grid in study.grid_names:
        figures = layout.path("report", study.name, grid)
        study_runs = StudyRuns(study, grid, pick(table, grid=grid), figures, lock)
        if study.learns_further_days:
            runs += of_strategies(study_runs)
        if study.tests_over_days:
            for method in study.methods:
                runs += runs_of_method(layout, study_runs, method)
    experiment = tracking.experiment_of(
        study.name, study.simulated, LIFELONG if study.learns_further_days else ""
    )
    published = tracking.publish(
        settings.tracking.database,
        experiment,
        runs,
        view=page.FURTHER_DAYS if study.learns_further_days else page.YEAR,
        files=settings.tracking.artifacts,
    )
    address = page.url(published.experiment_id, settings.tracking.host, settings.tracking.port)
    moved_note = ""
    if published.aside:
        moved_note = (
            "the folder moved, so the runs were rewritten; the old experiment is now "
            f"{published.aside}; "
        )
    return (
        f"{moved_note}{published.written} runs written, {published.kept} there already; "
        f"`make dashboard` serves them at {address}"
    )


def runs_of_method(
    layout: Layout, study_runs: StudyRuns, method: StudyMethod
) -> list[tracking.RunRecord]:
    """The runs of a method's own model: one for its poses if there are any, and one for itself."""
    study = study_runs.study
    grid = study_runs.grid
    path = layout.path("train", study.name, grid, method.name)
    recipe = store.read_recipe(path)
    costs = stage_costs(layout, study.name, grid, method, path)
    own_answers, *further_answers = study.answers_of(ModelName(method.name))
    runs = [
        study_runs.method_run(answers, {}, recipe, {})
        for answers in further_answers
        if not answers.path
    ]
    run = study_runs.method_run(own_answers, store.read_model(path), recipe, costs)
    return [*runs, replace(run, model=Served.read(path))]


if __name__ == "__main__":
    main()
