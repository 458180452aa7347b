"""What a model's file says of itself is enough to serve it."""

import sys
from pathlib import Path

import grimp
import numpy as np
import pytest

from pipeline import store
from pipeline.errors import InputError
from pipeline.tracking.served import OUTPUTS, REQUIREMENTS, Served

RECIPE = {
    "_target_": "pipeline.methods.sci.Sci",
    "learning_rate": 1e-05,
    "n_way": 2,
    "colormap": "jet",
    "crop": False,
    "grid": "10m",
}


def write(path: Path, recipe: dict[str, object]) -> Path:
    store.write_model(path, {"image_shape": np.array([40, 120])}, recipe)
    return path


def test_a_model_is_served_with_the_parameters_it_was_learned_with(tmp_path: Path) -> None:
    """The recipe's values are words in the file; their types come back."""
    served = Served.read(write(tmp_path / "sci.safetensors", RECIPE))
    assert served is not None
    assert served.method == "pipeline.methods.sci:Sci"
    assert served.image_shape == (40, 120)
    assert served.parameters == {"learning_rate": 1e-05, "n_way": 2, "colormap": "jet", "crop": False, "grid": "10m"}


def test_a_model_that_does_not_name_its_class_is_not_served(tmp_path: Path) -> None:
    assert Served.read(write(tmp_path / "sci.safetensors", {"n_way": 2})) is None


def test_a_model_changes_with_its_arrays(tmp_path: Path) -> None:
    path = write(tmp_path / "sci.safetensors", RECIPE)
    before = Served(path, "m:C", {}, (40, 120)).content()
    store.write_model(path, {"image_shape": np.array([40, 60])}, RECIPE)
    assert Served(path, "m:C", {}, (40, 120)).content() != before


def test_what_is_served_is_what_a_method_answers() -> None:
    from pipeline.matching.ranking import Ranking

    assert set(OUTPUTS) <= set(Ranking.__dataclass_fields__)


@pytest.mark.parametrize(("name", "method"), [("sci.pkl", "m:C"), ("gone.safetensors", "m:C"), ("sci.safetensors", "m.C")])
def test_only_a_safetensors_file_and_a_class_are_served(tmp_path: Path, name: str, method: str) -> None:
    write(tmp_path / "sci.safetensors", RECIPE)
    (tmp_path / "sci.pkl").touch()
    with pytest.raises(InputError):
        Served(tmp_path / name, method, {}, (40, 120))


def test_a_model_requires_what_the_methods_import() -> None:
    graph = grimp.build_graph("pipeline", include_external_packages=True, cache_dir=None)
    roots = {"pipeline.tracking.pyfunc"} | graph.find_children("pipeline.methods")
    imported = roots.union(*(graph.find_upstream_modules(root) for root in roots))
    packages = {module.partition(".")[0] for module in imported} - {"pipeline"} - sys.stdlib_module_names
    assert {"faiss-cpu" if package == "faiss" else package for package in packages} == set(REQUIREMENTS)
