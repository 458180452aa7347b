"""What a model's file says of itself is enough to serve it."""

import shutil
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import grimp
import numpy as np
import pytest
import yaml

from pipeline.core import store
from pipeline.core.building import target_of
from pipeline.core.errors import InputError
from pipeline.matching.ranking import Ranking
from pipeline.tracking import served
from pipeline.tracking.runs import RunRecord, publish
from pipeline.tracking.served import OUTPUTS, REQUIREMENTS, Served
from tests.methods.test_every_method import METHODS, learned

ROOT = Path(__file__).parents[2]
PARAMETERS = {"learning_rate": 1e-05, "n_way": 2, "colormap": "jet", "crop": False, "grid": "10m"}
RECIPE = {"_target_": "pipeline.methods.sci.Sci", **PARAMETERS}


def write(path: Path, recipe: dict[str, object]) -> Path:
    store.write_model(path, {"image_shape": np.array([40, 120])}, recipe)
    return path


def test_a_model_is_served_with_the_parameters_it_was_learned_with(tmp_path: Path) -> None:
    """The recipe's values are words in the file; their types come back."""
    path = write(tmp_path / "sci.zarr.zip", RECIPE)
    assert Served.read(path) == Served(path, "pipeline.methods.sci:Sci", PARAMETERS, (40, 120))


def test_a_model_that_does_not_name_its_class_is_not_served(tmp_path: Path) -> None:
    assert Served.read(write(tmp_path / "sci.zarr.zip", {"n_way": 2})) is None


def test_a_model_changes_with_its_arrays_and_with_the_code_that_it_ships(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = tmp_path / "pipeline"
    shutil.copytree(served.LIBRARY, library, ignore=shutil.ignore_patterns("__pycache__", ".numba"))
    monkeypatch.setattr(served, "LIBRARY", library)
    monkeypatch.setattr(served, "PYFUNC", library / "tracking/pyfunc.py")
    method = "pipeline.methods.scan_context:ScanContext"
    model = Served(write(tmp_path / "sci.zarr.zip", RECIPE), method, {}, (40, 120))
    before = model.content()
    assert model.content() == before
    store.write_model(model.arrays, {"image_shape": np.array([40, 60])}, RECIPE)
    assert model.content() != before
    for name, changes in {
        "report/figures/style.py": False,
        "matching/nearest.py": True,
        "methods/sci.py": False,
        "tracking/pyfunc.py": True,
    }.items():
        path = library / name
        before = model.content()
        path.write_text(path.read_text() + "\n")
        assert (model.content() != before) == changes


def test_all_that_a_method_answers_is_served() -> None:
    """But for the names of the kinds of novelty, which are words."""
    assert [*OUTPUTS, "kinds"] == [field.name for field in fields(Ranking)]


@pytest.mark.parametrize(
    ("name", "method"),
    [("sci.pkl", "m:C"), ("gone.zarr.zip", "m:C"), ("sci.zarr.zip", "m.C")],
)
def test_only_a_model_and_a_class_are_served(tmp_path: Path, name: str, method: str) -> None:
    write(tmp_path / "sci.zarr.zip", RECIPE)
    (tmp_path / "sci.pkl").touch()
    with pytest.raises(InputError):
        Served(tmp_path / name, method, {}, (40, 120))


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", include_external_packages=True, cache_dir=None)


@pytest.fixture(scope="module")
def imported(graph: grimp.ImportGraph) -> set[str]:
    """Every module, of the library or not, that a served method may import."""
    roots = {"pipeline.tracking.pyfunc"} | graph.find_descendants("pipeline.methods")
    return set(roots.union(*(graph.find_upstream_modules(root) for root in roots)))


def test_a_model_requires_what_the_methods_import(imported: set[str]) -> None:
    of_the_store = {
        "botocore",
        "s3fs",
    }  # an artifact in an object store needs them, a model does not
    packages = (
        {module.partition(".")[0] for module in imported}
        - {"pipeline"}
        - of_the_store
        - sys.stdlib_module_names
    )
    assert {"faiss-cpu" if package == "faiss" else package for package in packages} == set(
        REQUIREMENTS
    )


ALONE = """
import sys
from importlib.util import find_spec
from pathlib import Path

sys.path[:] = [folder for folder in sys.path if not Path(folder, "pipeline").exists()]
sys.meta_path[:] = [finder for finder in sys.meta_path if "__editable__" not in str(finder)]
assert find_spec("pipeline") is None
import mlflow
import numpy as np

_, database, model_id, views = sys.argv
mlflow.set_tracking_uri(f"sqlite:///{database}")
model = mlflow.pyfunc.load_model(f"models:/{model_id}")
print(model.predict(np.load(views), params={"k": 1})["places"].ravel().tolist())
"""
"""Loads a published model where this library is not installed, and prints its first answers."""


@pytest.mark.filterwarnings("ignore:The ``noload`` loader strategy is deprecated")
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # MLflow keeps its connections
def test_a_published_model_answers_where_this_library_is_not_installed(tmp_path: Path) -> None:
    import mlflow

    records = []
    for name in ("sci", "all"):
        method, training, _, _ = METHODS[name]
        recipe = {"_target_": target_of(method)}
        recipe |= {field.name: getattr(method, field.name) for field in fields(method)}
        shape = np.array(training.images.shape[1:])
        path = tmp_path / f"{name}.zarr.zip"
        store.write_model(path, {**learned(name), "image_shape": shape}, recipe)
        records.append(RunRecord(name, {}, {}, {}, model=Served.read(path)))
    database = tmp_path / "mlflow.db"
    published = publish(database, "alone", records)
    client = mlflow.MlflowClient(tracking_uri=f"sqlite:///{database}")
    models = client.search_logged_models([published.experiment_id])
    assert len(models) == len(records)
    for model in models:
        method, _, queries, _ = METHODS[model.name]
        np.save(tmp_path / "views.npy", queries.images)
        command = [sys.executable, "-I", "-c", ALONE, database, model.model_id]
        answer = subprocess.run(
            [*command, tmp_path / "views.npy"], capture_output=True, text=True, cwd=tmp_path
        )
        assert answer.returncode == 0, answer.stderr
        here = method.localizer(learned(model.name))(queries, 1)
        assert answer.stdout.strip() == str(here.places.ravel().tolist())


@pytest.mark.parametrize(
    "recipe", sorted((ROOT / "conf/method").glob("*.yaml")), ids=lambda p: p.stem
)
def test_a_model_ships_all_that_its_method_imports(recipe: Path, graph: grimp.ImportGraph) -> None:
    module, _, name = yaml.safe_load(recipe.read_text())["_target_"].rpartition(".")
    needed = {module}.union(
        *map(graph.find_upstream_modules, (module, "pipeline.tracking.pyfunc", "pipeline"))
    )
    ours = {each for each in needed if each.startswith("pipeline.")}
    packages = {".".join(each.split(".")[:length]) for each in ours for length in (1, 2, 3)}
    files = {path.relative_to(ROOT).with_suffix("") for path in served.shipped(f"{module}:{name}")}
    shipped = {".".join(file.parts).removesuffix(".__init__") for file in files}
    assert shipped == ours | packages
