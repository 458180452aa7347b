"""Models in MLflow's registry: one registered model a study, grid and method; its one version of
ours is the model in its run."""

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pipeline.tracking import served

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel

EXPERIMENT = "yearloc.experiment"  # the tag of what was registered here: the name of its experiment
MODEL = "yearloc.model"  # the tag of a version of ours: the id of the logged model
VERSIONS = "mlflow.modelVersions"  # the tag by which the page finds the versions of a logged model


def settle(
    client: "MlflowClient", experiment: str, experiment_id: str, wanted: Mapping[str, "LoggedModel"]
) -> None:
    """Register the model of each name unless it is, and take out versions of ours whose model is
    gone; others' are left alone.

    A registered model of ours without a version left is deleted.
    """
    registered = {one.name: one for one in _every(client.search_registered_models)}
    standing = [
        one
        for one in _every(client.search_model_versions)
        if one.tags.get(EXPERIMENT) == experiment
    ]
    there = {(one.name, one.tags.get(MODEL)) for one in standing}
    for name, model in wanted.items():
        if name not in registered:
            registered[name] = client.create_registered_model(name, tags={EXPERIMENT: experiment})
        if (name, model.model_id) not in there:
            _register(client, name, model, experiment)
    alive = {model.model_id: name for name, model in wanted.items()}
    unnamed = {
        model.model_id
        for models in served.owners(client, experiment_id).values()
        for model in models
    } - {*alive}
    for one in standing:
        number = one.tags.get(MODEL)
        if alive.get(number) != one.name and number not in unnamed:
            client.delete_model_version(one.name, one.version)
    kept = {one.name for one in _every(client.search_model_versions)}
    for name, one in registered.items():
        if name not in kept and one.tags.get(EXPERIMENT) == experiment:
            client.delete_registered_model(name)


def _register(client: "MlflowClient", name: str, model: "LoggedModel", experiment: str) -> None:
    """Add a version; given by its folder, since MLflow would look a `models:/` address up in
    another database."""
    made = client.create_model_version(
        name,
        model.artifact_location,
        model.source_run_id,
        tags={EXPERIMENT: experiment, MODEL: model.model_id},
        await_creation_for=0,
        model_id=model.model_id,
    )
    client.set_logged_model_tags(
        model.model_id, {VERSIONS: json.dumps([{"name": name, "version": int(made.version)}])}
    )


def _every(search: Any) -> Iterator[Any]:
    token = None
    while page := search(page_token=token):
        yield from page
        if not (token := page.token):
            return
