"""What a model's file says of itself is enough to serve it."""

import shutil
import sys
from dataclasses import fields
from pathlib import Path

import grimp
import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.errors import InputError
from pipeline.matching.ranking import Ranking
from pipeline.tracking import served
from pipeline.tracking.served import OUTPUTS, REQUIREMENTS, Served

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
    model = Served(write(tmp_path / "sci.zarr.zip", RECIPE), "m:C", {}, (40, 120))
    before = model.content()
    assert model.content() == before
    store.write_model(model.arrays, {"image_shape": np.array([40, 60])}, RECIPE)
    assert model.content() != before
    for name, changes in {
        "report/figures/style.py": False,
        "matching/nearest.py": True,
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
def imported() -> set[str]:
    """Every module, of the library or not, that a served method may import."""
    graph = grimp.build_graph("pipeline", include_external_packages=True, cache_dir=None)
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


def test_a_model_ships_what_the_methods_import(imported: set[str]) -> None:
    ours = {module.split(".")[1] for module in imported if module.startswith("pipeline.")} - {
        "tracking"
    }
    assert ours == {*served.FOLDERS}
