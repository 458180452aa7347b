"""The rules of the project that no other test checks."""

import ast
import itertools
import re
import subprocess
import sys
import tomllib
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from pydoc import locate
from types import ModuleType

import grimp
import numpy as np
import pytest
import yaml

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import NoveltyEvidence, Rejection

ROOT = Path(__file__).parents[1]
MODULES = sorted(ROOT.glob("pipeline/**/*.py"))
OURS = [*MODULES, *ROOT.glob("stages/**/*.py"), *ROOT.glob("worlds/**/*.py")]
UNSAFE = (
    "import pickle",
    "allow_pickle=True",
    "torch.load",
    "yaml.unsafe",
    "yaml.full_load",
    "yaml.Loader",
    "yaml.FullLoader",
)
METHODS = sorted(path.stem for path in (ROOT / "conf/method").glob("*.yaml"))


HEAVY = {"torch", "mlflow", "dask", "matplotlib"}
ARRAYS = {"pandas", "zarr", "numba", "numpy", "scipy"}


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("import yearloc, pipeline, pipeline.cli, pipeline.core.store", HEAVY),
        ("import pipeline.readers.nclt, pipeline.views.scan_context", HEAVY),
        ("from pipeline.cli import main; main(['--help'])", HEAVY | ARRAYS),
        ("from pipeline.studies.catalogue import entries; entries()", {"torch", "numpy"}),
    ],
)
def test_what_is_heavy_is_imported_where_it_is_needed(code, heavy):
    program = f"import sys\ntry: {code}\nfinally: print(*sys.modules)"
    out = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert not heavy & set(out.stdout.splitlines()[-1].split())


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(
        "benchmarks", "pipeline", "stages", "worlds", "yearloc", cache_dir=None
    )


def test_no_modules_import_each_other_in_a_circle(graph):
    """Whoever imports nothing that is left goes first; modules of a circle are never free to go."""
    waiting = {
        module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules
    }
    while free := {module for module, imported in waiting.items() if not imported & waiting.keys()}:
        waiting = {module: imported for module, imported in waiting.items() if module not in free}
    assert not waiting


def test_only_the_stage_and_the_command_line_import_the_report(graph):
    of_it = graph.find_descendants("pipeline.report") | {"pipeline.report"}
    importers = set().union(*map(graph.find_modules_that_directly_import, of_it)) - of_it
    assert {module for module in importers if not module.startswith("benchmarks")} == {
        "stages.report",
        "pipeline.cli.data",
        "pipeline.cli.picture",
        "pipeline.cli.results",
    }


def test_every_package_has_its_layer():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ][0]["layers"]
    listed = {name.split(".")[1] for layer in layers for name in layer.split(" | ") if "." in name}
    there = {
        path.stem
        for path in (ROOT / "pipeline").iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    assert listed == there - {"__init__"}


def test_the_library_neither_prints_nor_exits():
    """Only the command line does."""
    for path in (path for path in MODULES if path.parent.name != "cli"):
        calls = {
            ast.unparse(node.func)
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call)
        }
        assert not {"print", "exit", "quit", "sys.exit", "os._exit"} & calls, path


def constants() -> dict[str, list[tuple[Path, ast.expr]]]:
    """The modules that define each constant of a name, with the expressions of their values."""
    definitions: dict[str, list[tuple[Path, ast.expr]]] = {}
    for path in OURS:
        for node in ast.parse(path.read_text()).body:
            targets: list[ast.expr] = node.targets if isinstance(node, ast.Assign) else []
            if isinstance(node, ast.AnnAssign) and node.value:
                targets = [node.target]
            for target in targets:
                if isinstance(target, ast.Name) and target.id.isupper():
                    definitions.setdefault(target.id, []).append((path, node.value))
    return definitions


def words_of(value: ast.expr) -> set[str]:
    """The texts in a tuple, list or set that stands in the source."""
    if not isinstance(value, ast.Tuple | ast.List | ast.Set):
        return set()
    items = [item.value for item in value.elts if isinstance(item, ast.Constant)]
    return {item for item in items if isinstance(item, str)}


NUMBER = re.compile(r"-?[\d._e+-]+")
"""Two plain numbers of one name may be equal by chance."""


def test_no_constant_is_defined_twice():
    """Neither with the same value, nor as two lists that have most of their words in common."""
    for name, definitions in constants().items():
        for (path, value), (other_path, other) in itertools.combinations(definitions, 2):
            places = f"{name} in {path.relative_to(ROOT)} and in {other_path.relative_to(ROOT)}"
            text = ast.unparse(value)
            may_be_equal = NUMBER.fullmatch(text) or "__file__" in text
            assert may_be_equal or text != ast.unparse(other), f"{places}: the same value"
            words = words_of(value)
            other_words = words_of(other)
            shared = words & other_words
            is_one_list = 2 * len(shared) > min(len(words), len(other_words))
            assert not is_one_list, f"{places}: both have {sorted(shared)}"


def test_nothing_is_pickled_and_torch_loads_nothing_unsafe():
    texts = {path: path.read_text() for path in OURS}
    assert not [(path, word) for path, text in texts.items() for word in UNSAFE if word in text]


def test_text_is_read_and_written_with_its_encoding():
    """Never as the locale says.

    Of `open` ruff's PLW1514 sees the same; of paths in variables it does not.
    """
    found = []
    for path in (*OURS, *ROOT.glob("benchmarks/**/*.py")):
        for call in (
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
        ):
            given = {word.arg: ast.unparse(word.value) for word in call.keywords}
            name = call.func.attr if isinstance(call.func, ast.Attribute) else ""
            mode = ast.unparse(call.args[0]) if name == "open" and call.args else ""
            text = (
                name in ("read_text", "write_text")
                or given.get("text") == "True"
                or mode in ("'r'", "'w'", "'a'")
            )
            found += [f"{path}:{call.lineno}"] if text and "encoding" not in given else []
    assert not found


@pytest.mark.parametrize("path", sorted(ROOT.glob("stages/[a-z]*.py")), ids=lambda path: path.stem)
def test_a_stage_has_a_conf_of_its_name(path):
    assert (ROOT / "conf" / f"{path.stem}.yaml").is_file()


@pytest.mark.parametrize(
    "path", sorted(ROOT.glob("conf/dataset/*.yaml")), ids=lambda path: path.stem
)
def test_a_data_set_is_one_yaml_that_its_reader_takes(path):
    conf = yaml.safe_load(path.read_text())
    reader = dict(conf["reader"])
    assert hasattr(locate(reader.pop("_target_"))(**reader), "sequences")
    study = conf["study"]
    optional = {
        "split",
        "poses",
        "views",
        "perturbed",
        "variants",
        "viewpoints",
        "robustness",
        "lifelong",
    }
    needed = {
        "train",
        "tests",
        "submap",
        "grids",
        "methods",
        *([] if conf["simulated"] else ["expected"]),
    }
    assert study.keys() - optional == needed
    assert (ROOT / f"conf/submap/{study['submap']}.yaml").is_file()
    for preset in study["tests"] if conf["simulated"] else ():
        driven = yaml.safe_load((ROOT / f"conf/world/{path.stem}_{preset}.yaml").read_text())[
            "sequences"
        ]
        stress = study.get("robustness", {}).get("stress", {}).get(preset, {})
        further = [
            study.get("lifelong", {}).get(part, {}).get(preset, ())
            for part in ("tests", "learned", "self_training")
        ]
        asked = (study["train"], *study["tests"][preset], *stress, *itertools.chain(*further))
        assert {name.partition("-a")[0].partition("-b")[0] for name in asked} <= driven.keys()


def own_class(module: ModuleType) -> type:
    classes = [
        value
        for value in vars(module).values()
        if is_dataclass(value) and value.__module__ == module.__name__
    ]
    assert len(classes) == 1, f"{module.__name__}: one file, one method"
    return classes[0]


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_one_file_and_one_yaml_with_its_fields(name):
    conf = yaml.safe_load((ROOT / f"conf/method/{name}.yaml").read_text())
    module, _, kind = conf.pop("_target_").rpartition(".")
    method = own_class(import_module(module))
    assert module.startswith("pipeline.methods.")
    assert module.endswith(f".{name}")
    assert method.__name__ == kind
    assert (ROOT / f"conf/view/{conf['view']}.yaml").is_file()
    assert conf == {field.name: field.default for field in fields(method)}


def poles(rng: np.random.Generator) -> np.ndarray:
    """A scene of forty poles of 2 to 12 m, a point every 0.2 m."""
    xy_m = rng.uniform(-22, 22, (40, 2))
    heights_m = rng.uniform(2, 12, 40)
    return np.concatenate(
        [
            [(*xy, z) for z in np.arange(0.1, top, 0.2)]
            for xy, top in zip(xy_m, heights_m, strict=True)
        ]
    )


PLACES = np.repeat(np.arange(6), 5)
"""Six places in a row, five views of each that differ by a little noise."""
SMALL = {"rings": 16, "sectors": 48}
"""Scan Contexts on which a network trains six times as fast."""


MORE_STEPS = {"sci": {"share": 0.06, "batch": 8}}
"""Settings with thirty views a step, and so few steps that one seed in ten learns only half of the
places."""


def learned_and_queried(name: str, seed: int, **settings: object) -> tuple[Model, Ranking]:
    """A method's model of the places, and its answers to views of them under other noise."""
    conf = yaml.safe_load((ROOT / f"conf/method/{name}.yaml").read_text())
    look = yaml.safe_load((ROOT / f"conf/view/{conf['view']}.yaml").read_text())
    tiny = yaml.safe_load((ROOT / "conf/budget/tiny.yaml").read_text())
    words = {"share": 0.25} | tiny.get(name, {}) | MORE_STEPS.get(name, {})
    share = words.pop("share")
    conf |= words | {key: value for key, value in {**settings, "seed": seed}.items() if key in conf}
    look |= {key: value for key, value in SMALL.items() if key in look}
    view, method = (locate(described.pop("_target_"))(**described) for described in (look, conf))
    rng = np.random.default_rng(1)
    scenes = [poles(rng) for _ in range(6)]
    learned, asked = (
        np.stack(
            [view(scenes[place] + rng.normal(0, 0.03, scenes[place].shape)) for place in PLACES]
        )
        for _ in range(2)
    )
    world_T_anchor = np.tile(np.eye(4), (30, 1, 1))
    world_T_anchor[:, 0, 3] = 2.0 * np.arange(30)
    stamps_ns = 10**9 * np.arange(30, dtype=np.int64)
    model = method.learn(Rows(learned, stamps_ns, world_T_anchor), PLACES, Progress(budget=share))
    return model, method.localizer(model)(Rows(asked, stamps_ns, world_T_anchor), 3)


@pytest.mark.learning
@pytest.mark.parametrize("name", METHODS)
def test_every_method_learns_and_localises(name, seed, clears):
    """In float32, and long enough that any method knows the places whatever the processor's
    arithmetic."""
    model, ranking = learned_and_queried(name, seed, precision="f32", threads=1)
    assert all(isinstance(array, np.ndarray) for array in model.values())
    assert len(NoveltyEvidence.of(model).right)
    assert isinstance(ranking, Ranking)
    assert ranking.places.shape == ranking.costs.shape == (30, 3)
    assert ranking.xy_m.shape == (30, 3, 2)
    assert (np.diff(ranking.costs, axis=1) >= 0).all()
    assert ranking.novelty.shape == (30, len(ranking.kinds))
    assert np.isfinite(ranking.novelty).all()
    assert len(Rejection().thresholds(model, ranking.kinds)) == len(ranking.kinds)
    clears((ranking.places[:, 0] == PLACES).mean(), 0.6)


@pytest.mark.learning
@pytest.mark.parametrize(
    "name",
    [name for name in METHODS if "precision" in (ROOT / f"conf/method/{name}.yaml").read_text()],
)
def test_in_bfloat16_a_network_learns_finite_numbers_and_is_better_than_chance(name, seed, clears):
    """Processors sum differently, so no more is expected; a guess is right once in six."""
    model, ranking = learned_and_queried(name, seed, precision="bf16", threads=1)
    assert all(
        np.isfinite(array).all()
        for key, array in model.items()
        if array.dtype.kind == "f" and key.startswith("net/")
    )
    assert np.isfinite(ranking.costs).all()
    clears((ranking.places[:, 0] == PLACES).mean(), 1 / 3)
