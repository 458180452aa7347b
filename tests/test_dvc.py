"""dvc.yaml, conf/ and the import graph say the same thing."""

import atexit
import shlex
import shutil
import subprocess
import tempfile
from importlib import import_module
from pathlib import Path

import grimp
import pytest
import yaml
from dvc.repo import Repo
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from pipeline.core.settings import filled
from pipeline.studies.names import lists_text, studies_text
from pipeline.studies.studies_file import read_studies
from tests.clone import Clone

ROOT = Path(__file__).parents[1]
UNTRACKED = {"compute", "tracking"}  # groups that cannot change a result
UNTRACKED_MODULES = {
    f"pipeline.running.{name}" for name in ("ending", "memory", "telemetry", "texts")
}
"""Nor can who computes, what a stage costs, how it ends when asked to, how memory is kept, and what
is said of a broken file."""


def project() -> Path:
    """A copy of the project whose studies ask every question but `lifelong`, so that every stage
    has an instance."""
    clone = Clone(Path(tempfile.mkdtemp(prefix="yearloc-dvc-")))
    atexit.register(shutil.rmtree, clone.folder)
    clone.run(
        "yearloc", "use", "campus", "world=tiny", "poses=slam,sci_ring", "paths=filter,graph_all"
    )
    clone.run("yearloc", "use", "town", "world=tiny", "question=robustness", "--add")
    clone.run("yearloc", "use", "suburb", "world=tiny", "question=viewpoints", "--add")
    return clone.folder


PROJECT = project()
STAGES = list(Repo(PROJECT).index.stages)
GRAPH = grimp.build_graph("pipeline", "stages", "worlds", cache_dir=None)
STAGE = pytest.mark.parametrize(
    "stage", STAGES, ids=lambda stage: stage.addressing.rpartition(":")[2]
)


def composed(stage: object) -> tuple[str, DictConfig]:
    _, _, module, *overrides = shlex.split(stage.cmd)
    name = module.removeprefix("stages.")
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return name, compose(name, overrides, return_hydra_config=True)


def paths(stage: object, *, params: bool) -> set[str]:
    return {
        dep.def_path for dep in stage.deps if (type(dep).__name__ == "ParamsDependency") == params
    }


@STAGE
def test_params_are_the_files_that_the_stage_composes(stage):
    name, cfg = composed(stage)
    groups = {
        group: f"{group}/{choice}"
        for group, choice in cfg.hydra.runtime.choices.items()
        if not group.startswith("hydra/")
    }
    used = {name, *(file for group, file in groups.items() if group not in UNTRACKED)}
    assert paths(stage, params=True) == {f"conf/{file}.yaml" for file in used}


def targets(node: object) -> list[str]:
    """Every `_target_` in a composed config, as module paths."""
    if not isinstance(node, dict):
        return []
    own = [node["_target_"].rpartition(".")[0]] if "_target_" in node else []
    return own + [target for value in node.values() for target in targets(value)]


@STAGE
def test_deps_cover_the_modules_that_the_stage_can_import(stage):
    name, cfg = composed(stage)
    OmegaConf.set_struct(cfg, False)
    groups = {
        key: value
        for key, value in cfg.items()
        if isinstance(value, DictConfig) and key not in ("hydra", "tracking")
    }
    plain = {key: OmegaConf.to_container(value) for key, value in groups.items()}
    if name == "labels" or (name in ("logs", "events") and cfg.dataset.simulated):
        plain.pop("dataset")  # they look at the data set's box, and build no reader
    roots = {f"stages.{name}", *targets(plain)}
    needed = (
        roots.union(*(GRAPH.find_upstream_modules(root) for root in roots))
        - {"pipeline"}
        - UNTRACKED_MODULES
    )
    either = (
        Path(module.replace(".", "/") + end)
        for module in needed | {"stages"}
        for end in (".py", "/__init__.py")
    )
    files = {
        file for file in either if (ROOT / file).is_file() and (ROOT / file).read_text()
    }  # an empty package says nothing
    assert not {
        str(file) for file in files if not any(map(file.is_relative_to, paths(stage, params=False)))
    }


@STAGE
def test_a_command_gives_all_settings_of_its_stage(
    stage: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")  # stages.latency limits them, and they are put back
    name, cfg = composed(stage)
    filled(import_module(f"stages.{name}").Settings, cfg, lambda recipe: recipe)


@STAGE
def test_an_artifact_lies_in_the_folder_of_its_stage(stage):
    name, _ = composed(stage)
    if name == "absent":
        return  # in the folder of what there is none of
    folder = {"birdviews": "views"}.get(name, name)
    for out in stage.outs:
        assert Path(out.def_path).is_relative_to(
            "artifacts/metrics" if out.metric else f"artifacts/{folder}"
        )


def keys(node: object) -> set[str]:
    if isinstance(node, list):
        return set().union(*map(keys, node))
    return set(node).union(*map(keys, node.values())) if isinstance(node, dict) else set()


@pytest.mark.parametrize(
    "path", sorted((ROOT / "conf").rglob("*.yaml")), ids=lambda path: str(path.relative_to(ROOT))
)
def test_no_key_that_dvc_cannot_see(path):
    """DVC's run cache ignores keys named size and nfiles (treeverse/dvc#10296); ??? and ${} do not
    survive its reading."""
    text = path.read_text()
    assert not {"size", "nfiles"} & keys(yaml.safe_load(text) or {})
    assert "???" not in text
    assert "${" not in text


def test_the_lists_follow_from_the_studies():
    said = yaml.safe_load((ROOT / "conf/studies.yaml").read_text())["studies"]
    studies = read_studies(ROOT / "conf")
    assert (ROOT / "conf/lists.yaml").read_text() == lists_text(studies)
    assert yaml.safe_load(studies_text(studies))["studies"] == said


def test_only_the_report_depends_on_what_it_looks_like():
    shown = [
        stage
        for stage in STAGES
        if any(Path("pipeline/report").is_relative_to(dep) for dep in paths(stage, params=False))
    ]
    assert [stage.addressing.rpartition(":")[2].partition("@")[0] for stage in shown] == ["report"]
    assert not [
        dep
        for stage in STAGES
        for dep in paths(stage, params=False)
        if dep in ("pipeline", "stages")
    ]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of pygtrie, within DVC
def test_dvc_repro_builds_every_stage():
    """Without a target it builds the stages of the root's dvc.yaml and all before them."""
    last = {
        stage.path_in_repo
        for stage, dependents in Repo(PROJECT).index.graph.in_degree()
        if not dependents
    }
    assert last == {"dvc.yaml"}


def test_no_two_instances_of_a_stage_share_a_name():
    assert (
        len({stage.addressing for stage in STAGES})
        == len(STAGES)
        == len({stage.cmd for stage in STAGES})
    )


def test_a_command_has_no_blanks_that_dvc_lock_would_lose():
    """It is written in folded lines there, and a changed command runs again for ever."""
    assert not [stage.cmd for stage in STAGES if stage.cmd != " ".join(stage.cmd.split())]


def test_lock_files_are_plain_files_that_git_sees() -> None:
    """DVC's git file system follows no links, and what git ignores no other clone gets."""
    beside = [
        path.with_name("dvc.lock")
        for path in (ROOT / "dvc.yaml", *sorted((ROOT / "dag").glob("*/dvc.yaml")))
    ]
    assert not [lock for lock in beside if lock.is_symlink()]
    ignored = subprocess.run(
        ["git", "check-ignore", *map(str, beside)], cwd=ROOT, capture_output=True, text=True
    )
    assert ignored.stdout == ""
