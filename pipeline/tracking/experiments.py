"""The experiment that runs are published to: found by its name, created, brought back from MLflow's
bin, or made anew."""

from typing import TYPE_CHECKING

from pipeline.errors import ConfigError
from pipeline.tracking import served
from pipeline.tracking.databases import Database

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Experiment

KEY = "yearloc.key"
"""The tag of a run that was published here."""


def find(client: "MlflowClient", name: str, into: Database) -> tuple[str, str]:
    """The id of the experiment of this name whose files go where the database says; and the name
    that an older one now bears.

    That name is empty but where the folder moved: MLflow fixes an experiment's folder when it is
    made. An experiment whose files went elsewhere is then put aside, and deleted unless it holds
    runs that were not published here. In a server's database it may be somebody else's, who would
    do the same to ours: ConfigError.
    """
    found = client.get_experiment_by_name(name)
    aside = ""
    if found is not None and found.artifact_location != into.files and into.shared:
        raise ConfigError(
            f"tracking.artifacts={into.files}: {name} keeps its files at "
            f"{found.artifact_location}; say that"
        )
    if found is not None and found.lifecycle_stage == "deleted":
        client.restore_experiment(found.experiment_id)
    if found is not None and found.artifact_location != into.files:
        aside = _put_aside(client, found)
        found = None
    if found is None:
        return str(client.create_experiment(name, artifact_location=into.files)), aside
    return str(found.experiment_id), aside


def _put_aside(client: "MlflowClient", old: "Experiment") -> str:
    """The name that the experiment is given; its files are left alone, since another copy of the
    project may show them."""
    aside = f"{old.name}, folder moved ({old.experiment_id})"
    client.rename_experiment(old.experiment_id, aside)
    runs = list(served.every(client.search_runs, old.experiment_id))
    for models in served.owners(client, old.experiment_id).values():
        for model in models:
            client.delete_logged_model(model.model_id)
    for run in runs:
        if KEY in run.data.tags:
            client.delete_run(run.info.run_id)
    if all(KEY in run.data.tags for run in runs):
        client.delete_experiment(old.experiment_id)
    return aside
