"""Fingerprints: the same inputs have the same one, others another."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.running.provenance import fingerprint

ARRAY = np.arange(6, dtype=np.int32).reshape(2, 3)


def test_the_same_parts_have_the_same_key() -> None:
    assert fingerprint(ARRAY, "a", {"x": 1}) == fingerprint(ARRAY.copy(), "a", {"x": 1})


@pytest.mark.parametrize(
    "other",
    [
        ARRAY + 1,
        ARRAY.astype(np.int64),
        ARRAY.reshape(3, 2),
        ARRAY.view(np.float32),
        ARRAY.T.copy(),
        ARRAY[:1],
    ],
)
def test_another_array_has_another_key(other: np.ndarray) -> None:
    assert fingerprint(other, 1.0) != fingerprint(ARRAY, 1.0)


def test_the_order_in_memory_does_not_matter() -> None:
    assert fingerprint(np.asfortranarray(ARRAY)) == fingerprint(ARRAY)


@pytest.mark.parametrize(
    ("one", "other"), [((1.0,), (2.0,)), (("a",), ("b",)), ((1, 2), (2, 1)), ((1, 23), (12, 3))]
)
def test_other_parameters_have_another_key(
    one: tuple[object, ...], other: tuple[object, ...]
) -> None:
    assert fingerprint(*one) != fingerprint(*other)


def test_a_class_is_known_by_its_code_and_by_what_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of two modules of this project one imports the other. An edit in either gives another key;
    # once it is undone, the first key comes back.
    sources = {
        "pipeline.probe_helper": "class Base: pass\n",
        "pipeline.probe": "from pipeline.probe_helper import Base\nclass Method(Base): pass\n",
    }
    for name, text in sources.items():
        (tmp_path / f"{name}.py").write_text(text)
        spec = importlib.util.spec_from_file_location(name, tmp_path / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        monkeypatch.setitem(sys.modules, name, importlib.util.module_from_spec(spec))
        spec.loader.exec_module(sys.modules[name])
    method = vars(sys.modules["pipeline.probe"])["Method"]
    keys = [fingerprint(method)]
    for name, text in sources.items():
        (tmp_path / f"{name}.py").write_text(text + "# edited\n")
        keys.append(fingerprint(method))
        (tmp_path / f"{name}.py").write_text(text)
    assert len(set(keys)) == 3
    assert fingerprint(method) == keys[0]
