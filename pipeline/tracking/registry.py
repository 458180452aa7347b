"""Models in MLflow's registry: one registered model per study, cell size and method.

A version of it is the model in a published run. When the run is replaced, its version goes too,
and its aliases, tags and description go over to the next.
"""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pipeline.tracking import served

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel
    from mlflow.entities.model_registry import ModelVersion, RegisteredModel

EXPERIMENT = "yearloc.experiment"  # the tag of what was registered here: the name of its experiment
MODEL = "yearloc.model"  # the tag of a version of ours: the id of the logged model
VERSIONS = "mlflow.modelVersions"  # the tag by which the page finds the versions of a logged model


def settle(
    client: "MlflowClient",
    experiment: str,
    experiment_id: str,
    logged_models: Mapping[str, "LoggedModel"],
) -> None:
    """Register the models by name, and delete versions published here whose model is gone.

    A registered model published here that has no version left is deleted. Models that others
    registered are left alone.
    """
    registered = {
        registered_model.name: registered_model
        for registered_model in served.all_results(client.search_registered_models)
    }
    own_versions = [
        version
        for version in served.all_results(client.search_model_versions)
        if version.tags.get(EXPERIMENT) == experiment
    ]
    version_of = {(version.name, version.tags.get(MODEL)): version for version in own_versions}
    for name, model in logged_models.items():
        if name not in registered:
            registered[name] = client.create_registered_model(name, tags={EXPERIMENT: experiment})
        if (name, model.model_id) not in version_of:
            versions = [version for version in own_versions if version.name == name]
            _register(client, registered[name], model, experiment, versions)
    names = {model.model_id: name for name, model in logged_models.items()}
    # logged models that are not among these: their versions stay
    other_models = {
        model.model_id
        for models in served.models_by_run(client, experiment_id).values()
        for model in models
        if model.model_id not in names
    }
    for version in own_versions:
        model_id = version.tags.get(MODEL)
        if names.get(model_id) != version.name and model_id not in other_models:
            client.delete_model_version(version.name, version.version)
    names_with_version = {
        version.name for version in served.all_results(client.search_model_versions)
    }
    for name, registered_model in registered.items():
        if name not in names_with_version and registered_model.tags.get(EXPERIMENT) == experiment:
            client.delete_registered_model(name)


def _register(
    client: "MlflowClient",
    registered_model: "RegisteredModel",
    model: "LoggedModel",
    experiment: str,
    earlier: Sequence["ModelVersion"],
) -> None:
    """Add a version of a registered model, which takes over what people gave the last earlier one.

    Those are its description and tags, and the aliases of all earlier ones. The version is given by
    its folder, since MLflow would look a `models:/` address up in another database.
    """
    name = registered_model.name
    last = max(earlier, key=lambda version: int(version.version), default=None)
    tags = {**last.tags} if last else {}
    version = client.create_model_version(
        name,
        model.artifact_location,
        model.source_run_id,
        tags={**tags, EXPERIMENT: experiment, MODEL: model.model_id},
        description=last.description if last else None,
        await_creation_for=0,
        model_id=model.model_id,
    )
    replaced = {int(version.version) for version in earlier}
    for alias, number in registered_model.aliases.items():
        if int(number) in replaced:
            client.set_registered_model_alias(name, alias, version.version)
    client.set_logged_model_tags(
        model.model_id, {VERSIONS: json.dumps([{"name": name, "version": int(version.version)}])}
    )
