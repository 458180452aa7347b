"""The table of results, models and figures → MLflow, which can be thrown away and published anew at
any time."""

from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.core import store
from pipeline.evaluation import results
from pipeline.running.dvc_files import DvcLock
from pipeline.studies import measured
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import LIFELONG
from pipeline.tracking import page
from pipeline.tracking import runs as tracking
from pipeline.tracking.records import StudyRuns, of_strategies, stage_costs
from pipeline.tracking.served import Served
from stages import stage


@dataclass(frozen=True)
class Tracking:
    """A file of conf/tracking."""

    host: str
    port: int
    database: str
    artifacts: str = ""


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
    runs = list[tracking.RunRecord]()
    table = results.read(layout, {study.name: study})
    lock = DvcLock.read(layout.root.parent / "dvc.lock")
    further = study.learns_further_days
    for grid in study.grid_names:
        figures = layout.path("report", study.name, grid)
        study_runs = StudyRuns(study, grid, table[table["grid"] == grid], figures, lock)
        runs += of_strategies(study_runs) if further else ()
        for method in study.methods if study.asks_about_the_year else ():
            path = layout.path("train", study.name, grid, method.name)
            extra = stage_costs(layout, study.name, grid, method, path)
            own_answers, *further_answers = study.answers_of(ModelName(method.name))
            recipe = store.read_recipe(path)
            runs += [
                study_runs.method_run(posed, {}, recipe, {})
                for posed in further_answers
                if not posed.path
            ]
            run = study_runs.method_run(own_answers, store.read_model(path), recipe, extra)
            runs.append(replace(run, model=Served.read(path)))
    name = tracking.experiment_of(study.name, study.simulated, LIFELONG if further else "")
    published = tracking.publish(
        settings.tracking.database,
        name,
        runs,
        page.FURTHER_DAYS if further else page.YEAR,
        settings.tracking.artifacts,
    )
    address = page.url(published.experiment_id, settings.tracking.host, settings.tracking.port)
    moved_note = (
        "the folder moved, so the runs were written anew; the old experiment is now "
        f"{published.aside}; "
        if published.aside
        else ""
    )
    return (
        f"{moved_note}{published.written} runs written, {published.kept} there already; "
        f"`make dashboard` serves them at {address}"
    )


if __name__ == "__main__":
    main()
