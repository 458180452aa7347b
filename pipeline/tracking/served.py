"""A method's model as MLflow serves it: its arrays, its code and a signature; no pickle.

In: the file of a trained model. Out: an MLflow model in a run; `pyfunc` is the code that loads it.
`mlflow.pyfunc.load_model("models:/m-…").predict(views)` ranks places for views, such as heights
(query, ring, sector) in metres.
"""

import ast
import hashlib
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from pipeline.core import store
from pipeline.core.building import parsed
from pipeline.core.errors import InputError
from pipeline.tracking.page import filled

if TYPE_CHECKING:
    from mlflow import MlflowClient

LIBRARY = Path(__file__).parents[1]
# The packages that localising imports. They are listed, since MLflow would else try the model out
# for half a minute to find them.
REQUIREMENTS = (
    "faiss-cpu",
    "mlflow",
    "numba",
    "numpy",
    "psutil",
    "safetensors",
    "scipy",
    "torch",
    "zarr",
)
OUR_TAG = "yearloc.model"  # the tag of a model that was logged here; others are somebody else's
PYFUNC = LIBRARY / "tracking/pyfunc.py"  # what MLflow runs to load the model
Dims = tuple[str | int, ...]  # a shape: the name of a dimension of any size, or its fixed size
# The columns of `pipeline.matching.ranking.Ranking` that are served: type and shape of each.
OUTPUTS: Mapping[str, tuple[type, Dims]] = {
    "places": (np.int64, ("query", "rank")),
    "costs": (np.float32, ("query", "rank")),
    "xy_m": (np.float64, ("query", "rank", 2)),
    "novelty": (np.float32, ("query", "kind")),
    "confidence": (np.float32, ("query",)),
    "heading_deg": (np.float32, ("query", "rank")),
}


@dataclass(frozen=True)
class Served:
    """A trained model with everything needed to localise with it."""

    arrays: Path  # the model that `stages.train` wrote
    method: str  # module and class, as `pipeline.methods.sci:Sci`
    # The arguments of the method's constructor; pyfunc.py leaves out those without a field.
    parameters: Mapping[str, bool | int | float | str]
    image_shape: tuple[int, ...]  # of one view, such as rings and sectors
    k: int = 25  # places ranked unless `predict(views, params={"k": …})` asks for another number

    def __post_init__(self) -> None:
        if not self.arrays.name.endswith(store.MODEL) or not self.arrays.is_file():
            raise InputError(f"{self.arrays}: no {store.MODEL} file")
        if ":" not in self.method:
            raise InputError(f"method {self.method}: expected module:class")

    @classmethod
    def read(cls, arrays: Path) -> Self | None:
        """The model in a file of `stages.train`; None if its recipe has no class as `_target_`."""
        recipe = store.read_recipe(arrays)
        model = store.read_model(arrays)
        if "_target_" not in recipe or "image_shape" not in model:
            return None
        module, _, name = recipe["_target_"].rpartition(".")
        parameters = {key: parsed(value) for key, value in recipe.items() if key != "_target_"}
        return cls(arrays, f"{module}:{name}", parameters, tuple(map(int, model["image_shape"])))

    def content(self) -> dict[str, object]:
        """Everything that the logged model holds, its code included, files as digests.

        Models of equal content are the same: `RunRecord.key` hashes it, so that a run is written
        once only.
        """
        files = (PYFUNC, *shipped(self.method))
        return asdict(self) | {
            "arrays": digest(self.arrays),
            "parameters": dict(self.parameters),
            "code": {path.relative_to(LIBRARY).as_posix(): digest(path) for path in files},
        }

    @property
    def inputs(self) -> dict[str, tuple[type, Dims]]:
        """The inputs of `predict`, type and shape of each: views, as the method looks at them."""
        return {"views": (np.float32, ("query", *self.image_shape))}

    def note(self, model_id: str) -> str:
        """The text of the model's page: how to call it, and its signature.

        MLflow itself shows the signature in a file only.
        """
        return filled(
            "model.md.j2", model_id=model_id, k=self.k, inputs=self.inputs, outputs=OUTPUTS
        )

    def save(self, folder: Path, **metadata: Any) -> None:
        """Write an MLflow model into a new folder; `metadata` goes into its MLmodel file."""
        with warnings.catch_warnings(), TemporaryDirectory() as scratch:
            # MLflow warns that it reads no signature from the type hints of `predict`, and that
            # there is no example of an input; the signature is given, so neither is needed
            warnings.simplefilter("ignore")
            from mlflow.models import Model
            from mlflow.pyfunc import save_model

            code = Path(scratch, LIBRARY.name)
            for path in shipped(self.method):
                target = code / path.relative_to(LIBRARY)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
            config = {
                "method": self.method,
                "parameters": dict(self.parameters),
                "outputs": list(OUTPUTS),
            }
            save_model(
                folder,
                python_model=str(PYFUNC),
                artifacts={"arrays": str(self.arrays)},
                code_paths=[str(code)],
                model_config=config,
                signature=self._signature(),
                pip_requirements=[
                    f"{name}=={version(name).partition('+')[0]}" for name in REQUIREMENTS
                ],
                mlflow_model=Model(**metadata),
            )

    def _signature(self) -> Any:
        """The inputs, outputs and parameters of `predict`, as MLflow has them."""
        from mlflow.models import ModelSignature
        from mlflow.types import ParamSchema, ParamSpec, Schema, TensorSpec

        schemas = []
        for tensors in (self.inputs, OUTPUTS):
            specs = []
            for name, (number_type, dims) in tensors.items():
                # MLflow writes -1 for a dimension of any size
                shape = tuple(-1 if isinstance(dim, str) else dim for dim in dims)
                specs.append(TensorSpec(np.dtype(number_type), shape, name))
            schemas.append(Schema(specs))
        return ModelSignature(*schemas, ParamSchema([ParamSpec("k", "long", self.k)]))


def shipped(method: str) -> list[Path]:
    """The source files that go into a logged model's `code` folder.

    They are the modules of this library that `method` (module:class) and PYFUNC import, directly or
    through others, with the packages that these lie in. So the model loads where this library is
    not installed.
    """
    files = set[Path]()
    waiting = {method.partition(":")[0], *_imports(PYFUNC)}
    while waiting:
        module = waiting.pop()
        path = _source(module)
        if path and path not in files:
            files.add(path)
            waiting |= {module.rpartition(".")[0], *_imports(path)}
    return sorted(files)


def _imports(path: Path) -> set[str]:
    """What a file imports anywhere in it: modules, and names that may be modules."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def _source(module: str) -> Path | None:
    """The source file of a module of this library; None for anything else."""
    root, *parts = module.split(".")
    path = LIBRARY.joinpath(*parts)
    candidates = (path / "__init__.py", path.with_suffix(".py"))
    if root != LIBRARY.name:
        return None
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def log(client: "MlflowClient", experiment_id: str, run_id: str, name: str, served: Served) -> None:
    """Add the model to a run."""
    from mlflow.entities import LoggedModelOutput

    parameters = {key: str(value) for key, value in served.parameters.items()}
    params = {"method": served.method, **parameters}
    model = client.create_logged_model(experiment_id, name, run_id, params=params)
    client.set_logged_model_tags(
        model.model_id, {OUR_TAG: "true", "mlflow.note.content": served.note(model.model_id)}
    )
    with TemporaryDirectory() as scratch:
        folder = Path(scratch, "model")
        metadata = {
            "run_id": run_id,
            "artifact_path": model.artifact_location,
            "model_uuid": model.model_id,
            "model_id": model.model_id,
        }
        served.save(folder, **metadata)
        client.log_model_artifacts(model.model_id, str(folder))
    client.finalize_logged_model(model.model_id, "READY")
    client.log_outputs(run_id, [LoggedModelOutput(model.model_id, step=0)])


def models_by_run(client: "MlflowClient", experiment_id: str) -> dict[str, list[Any]]:
    """The logged models of this project, by the id of the run that they belong to."""
    models: dict[str, list[Any]] = {}
    for model in all_results(client.search_logged_models, experiment_id):
        if OUR_TAG in model.tags:
            models.setdefault(str(model.source_run_id), []).append(model)
    return models


def all_results(search: Callable[..., Any], *experiment_ids: str) -> Iterator[Any]:
    """All results of an MLflow search, page by page, in the experiments if any are given."""
    token = None
    # the first argument of a search within experiments; other searches have none
    arguments = [[*experiment_ids]] if experiment_ids else []
    while page := search(*arguments, page_token=token):
        yield from page
        if not (token := page.token):
            return


def delete(client: "MlflowClient", model: Any) -> None:
    """Delete a model, and its files, which are copies, on the disk or in the object store."""
    client.delete_logged_model(model.model_id)
    # the artifacts lie in …/models/MODEL_ID/artifacts; the model's own folder is the one above
    folder = str(model.artifact_location).removesuffix("/artifacts")
    if folder.endswith(f"/{model.model_id}"):
        delete_files(folder)


def delete_files(address: str, path: str | None = None) -> None:
    """Delete what lies at an address of MLflow's files, on the disk or in the object store."""
    from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

    get_artifact_repository(address).delete_artifacts(path)


def digest(path: Path) -> str:
    """The SHA-256 of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
