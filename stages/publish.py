"""The table of results, models and figures → MLflow, which can be thrown away and published anew at
any time."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.evaluation import results
from pipeline.running.dvc_files import DvcLock
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import LIFELONG
from pipeline.tracking import further_days, page
from pipeline.tracking import runs as tracking
from pipeline.tracking.records import Source, measured, with_model
from stages import ROOT, stage


@stage("publish")
def main(cfg: DictConfig) -> str:
    study = studies(ROOT / "conf")[cfg.study]
    layout = Layout(Path(cfg.artifacts))
    runs = list[tracking.RunRecord]()
    table = results.read(layout, {cfg.study: study})
    lock = DvcLock.read(layout.root.parent / "dvc.lock")
    further = study.learns_further_days
    for grid in study.grid_names:
        figures = layout.path("report", study.name, grid)
        source = Source(study, grid, table[table["grid"] == grid], figures, lock)
        runs += further_days.records(source) if further else ()
        for method in study.methods if study.asks_about_the_year else ():
            path = layout.path("train", study.name, grid, method.name)
            extra = measured(layout, study.name, grid, method, path)
            own_answers, *further_answers = study.answers_of(ModelName(method.name))
            recipe = store.read_recipe(path)
            runs += [
                source.record(posed, {}, recipe, {}) for posed in further_answers if not posed.path
            ]
            runs.append(
                with_model(source.record(own_answers, store.read_model(path), recipe, extra), path)
            )
    name = tracking.experiment_of(study.name, study.simulated, LIFELONG if further else "")
    published = tracking.publish(
        cfg.tracking.database,
        name,
        runs,
        page.FURTHER_DAYS if further else page.YEAR,
        cfg.tracking.artifacts,
    )
    address = page.url(published.experiment_id, cfg.tracking.host, cfg.tracking.port)
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
