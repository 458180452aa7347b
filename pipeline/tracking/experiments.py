"""Finds or creates the MLflow experiment that runs are published to.

It is found by its name, and restored if somebody deleted it. MLflow fixes the folder of an
experiment's files when it is made, so one whose folder has moved is put aside for a new one.
"""

from typing import TYPE_CHECKING

from pipeline.core.errors import ConfigError
from pipeline.tracking import served
from pipeline.tracking.databases import Database

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Experiment

KEY = "yearloc.key"  # the tag of a run that was published here


def find(client: "MlflowClient", name: str, database: Database) -> tuple[str, str]:
    """The id of the experiment of this name whose files go where the database says, and `aside`.

    `aside` is the new name of an older experiment of this name whose files went to another folder,
    else empty. Raises ConfigError for such an experiment in a server's database: it may be somebody
    else's, who would put ours aside in turn.
    """
    aside = ""
    if experiment := client.get_experiment_by_name(name):
        has_moved = experiment.artifact_location != database.files
        if has_moved and database.shared:
            raise ConfigError(
                f"tracking.artifacts={database.files}: {name} keeps its files at "
                f"{experiment.artifact_location}; say that"
            )
        if experiment.lifecycle_stage == "deleted":
            client.restore_experiment(experiment.experiment_id)
        if not has_moved:
            return str(experiment.experiment_id), ""
        aside = _put_aside(client, experiment)
    return str(client.create_experiment(name, artifact_location=database.files)), aside


def _put_aside(client: "MlflowClient", experiment: "Experiment") -> str:
    """Rename an experiment, delete its runs that were published here, and return its new name.

    It is deleted too if it holds no other runs. Its files are left alone, since another copy of the
    project may show them.
    """
    aside = f"{experiment.name}, folder moved ({experiment.experiment_id})"
    client.rename_experiment(experiment.experiment_id, aside)
    runs = list(served.all_results(client.search_runs, experiment.experiment_id))
    for models in served.models_by_run(client, experiment.experiment_id).values():
        for model in models:
            client.delete_logged_model(model.model_id)
    for run in runs:
        if KEY in run.data.tags:
            client.delete_run(run.info.run_id)
    if all(KEY in run.data.tags for run in runs):
        client.delete_experiment(experiment.experiment_id)
    return aside
