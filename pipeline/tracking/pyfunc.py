"""The code of a logged model: MLflow copies this file and runs it; nothing is unpickled.

MLflow calls this "models from code". Nothing of this project imports it. `pipeline.tracking.served`
says what its `model_config` and its artifacts hold.
"""

from dataclasses import fields
from importlib import import_module
from typing import Any

import mlflow
import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.matching.ranking import Rows


class Localizer(mlflow.pyfunc.PythonModel):  # type: ignore[misc]  # MLflow is not typed here
    """A method, rebuilt from its name and parameters, with the arrays that it learned."""

    def load_context(self, context: Any) -> None:
        """Build the method and load its arrays from what was logged."""
        module, _, name = context.model_config["method"].partition(":")
        kind = getattr(import_module(module), name)
        parameters = context.model_config["parameters"]
        method = kind(
            **{
                field.name: parameters[field.name]
                for field in fields(kind)
                if field.name in parameters
            }
        )
        self.localizer = method.localizer(store.read_model(context.artifacts["arrays"]))
        self.outputs = context.model_config["outputs"]

    def predict(
        self, context: Any, model_input: np.ndarray, params: Any = None
    ) -> dict[str, NDArray[Any]]:
        """Rank the `k` likeliest places of each image.

        MLflow knows the bare `np.ndarray` alone, and hands over a named one.
        """
        (images,) = model_input.values() if isinstance(model_input, dict) else (model_input,)
        nowhere = np.tile(np.eye(4), (len(images), 1, 1))
        ranking = self.localizer(
            Rows(images, np.zeros(len(images), np.int64), nowhere), int(params["k"])
        )
        return {name: np.asarray(getattr(ranking, name)) for name in self.outputs}


mlflow.models.set_model(Localizer())
