"""dvc.yaml, conf/ and the import graph say the same thing."""

import shlex
import subprocess
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import grimp
import pytest
import yaml
from dvc.repo import Repo
from dvc.stage import PipelineStage
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from pipeline.core.settings import filled
from pipeline.studies.studies_file import lists_text, read_studies, studies_text
from tests.clone import Clone
from tests.mapping import made_map

ROOT = Path(__file__).parents[1]
REPORT = Path("pipeline/report")
GROUPS = {path.name for path in (ROOT / "conf").iterdir() if path.is_dir()}
UNTRACKED = {"compute", "tracking"}  # groups that cannot change a result
UNTRACKED_MODULES = {
    "pipeline.kernel_cache",
    *(f"pipeline.running.{name}" for name in ("process", "telemetry", "texts")),
}
"""Modules that cannot change a result either: they choose where compiled kernels are kept and who
computes, sample costs, end a stage on SIGTERM, keep memory, and report a broken file."""


@dataclass(frozen=True)
class Instance:
    """A stage of the chain, and what its command composes of conf/."""

    stage: PipelineStage
    name: str
    cfg: DictConfig

    def paths(self, *, params: bool) -> set[str]:
        """The files of conf/ that it depends on, or the other paths."""
        return paths(self.stage, params=params)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project whose studies have every kind of experiment but `lifelong`, so that
    every stage has an instance."""
    clone = Clone(tmp_path_factory.mktemp("dvc"))
    clone.run(
        "yearloc", "use", "campus", "world=tiny", "poses=slam,sci_ring", "paths=filter,graph_all"
    )
    clone.run("yearloc", "use", "town", "world=tiny", "experiment=robustness", "--add")
    clone.run("yearloc", "use", "suburb", "world=tiny", "experiment=viewpoints", "--add")
    root = made_map.drive(tmp_path_factory.mktemp("drives"))
    clone.run("yearloc", "use", "nova", f"map={root / 'town.pcd'}", f"root={root}", "--add")
    return clone.folder


@pytest.fixture(scope="module")
def stages(project: Path) -> list[PipelineStage]:
    return list(Repo(project).index.stages)


@pytest.fixture(scope="module")
def instances(stages: list[PipelineStage]) -> list[Instance]:
    """One of all stages that differ in no more than the paths and plain values of their words."""
    kinds: dict[object, Instance] = {}
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        for stage in stages:
            _, _, module, *overrides = shlex.split(stage.cmd)
            words = [word.lstrip("+").split("=", 1) for word in overrides]
            choices = {(key, value if key in GROUPS else "") for key, value in words}
            of_code = {path for path in paths(stage, params=False) if "artifacts" not in path}
            kind = (module, *map(frozenset, (choices, of_code, paths(stage, params=True))))
            if kind not in kinds:
                name = module.removeprefix("stages.")
                cfg = compose(name, overrides, return_hydra_config=True)
                kinds[kind] = Instance(stage, name, cfg)
    return list(kinds.values())


def paths(stage: PipelineStage, *, params: bool) -> set[str]:
    return {
        dep.def_path for dep in stage.deps if (type(dep).__name__ == "ParamsDependency") == params
    }


def test_params_are_the_files_that_the_stage_composes(instances: list[Instance]) -> None:
    for instance in instances:
        groups = {
            group: f"{group}/{choice}"
            for group, choice in instance.cfg.hydra.runtime.choices.items()
            if not group.startswith("hydra/")
        }
        used = {file for group, file in groups.items() if group not in UNTRACKED}
        files = {f"conf/{file}.yaml" for file in {instance.name, *used}}
        assert instance.paths(params=True) == files, instance.stage


def targets(node: object) -> list[str]:
    """Every `_target_` in a composed config, as module paths."""
    if not isinstance(node, dict):
        return []
    own = [node["_target_"].rpartition(".")[0]] if "_target_" in node else []
    return own + [target for value in node.values() for target in targets(value)]


def test_deps_cover_the_modules_that_the_stage_can_import(instances: list[Instance]) -> None:
    graph = grimp.build_graph("pipeline", "stages", "worlds", cache_dir=None)
    for instance in instances:
        groups = {
            key: OmegaConf.to_container(value)
            for key, value in instance.cfg.items()
            if isinstance(value, DictConfig) and key not in ("hydra", "tracking")
        }
        simulated = instance.name in ("logs", "events") and instance.cfg.dataset.simulated
        if instance.name == "labels" or simulated:
            del groups["dataset"]  # they look at the data set's box, and build no reader
        roots = {f"stages.{instance.name}", *targets(groups)}
        upstream = set().union(*(graph.find_upstream_modules(root) for root in roots))
        needed = (roots | upstream | {"stages"}) - {"pipeline"} - UNTRACKED_MODULES
        either = (
            Path(module.replace(".", "/") + end)
            for module in needed
            for end in (".py", "/__init__.py")
        )
        # an empty package says nothing
        files = {file for file in either if (ROOT / file).is_file() and (ROOT / file).read_text()}
        deps = instance.paths(params=False)
        missing = {str(file) for file in files if not any(map(file.is_relative_to, deps))}
        assert not missing, instance.stage


def test_a_command_gives_all_settings_of_its_stage(
    instances: list[Instance], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")  # stages.latency limits them, and they are put back
    for instance in instances:
        settings = import_module(f"stages.{instance.name}").Settings
        filled(settings, instance.cfg, lambda _, setting: setting)


def test_an_artifact_lies_in_the_folder_of_its_stage(stages: list[PipelineStage]) -> None:
    for stage in stages:
        name = shlex.split(stage.cmd)[2].removeprefix("stages.")
        folders = {"birdviews": ("views",), "squares": ("map", "scans")}.get(name, (name,))
        if name == "absent":
            continue  # in the folder of what there is none of
        for out in stage.outs:
            own = ("metrics",) if out.metric else folders
            assert Path(out.def_path).parts[:1] == ("artifacts",), stage
            assert Path(out.def_path).parts[1] in own, stage


def keys(node: object) -> set[str]:
    if isinstance(node, list):
        return set().union(*map(keys, node))
    return set(node).union(*map(keys, node.values())) if isinstance(node, dict) else set()


def test_no_key_that_dvc_cannot_see() -> None:
    """DVC's run cache ignores keys named size and nfiles (treeverse/dvc#10296); ??? and ${} do not
    survive its reading."""
    for path in (ROOT / "conf").rglob("*.yaml"):
        text = path.read_text()
        hidden = {"size", "nfiles"} & keys(yaml.safe_load(text) or {})
        assert not hidden | {sign for sign in ("???", "${") if sign in text}, path


def test_the_lists_follow_from_the_studies():
    said = yaml.safe_load((ROOT / "conf/studies.yaml").read_text())["studies"]
    studies = read_studies(ROOT / "conf")
    assert (ROOT / "conf/lists.yaml").read_text() == lists_text(studies)
    assert yaml.safe_load(studies_text(studies))["studies"] == said


def test_only_the_report_depends_on_what_it_looks_like(stages: list[PipelineStage]) -> None:
    deps = {stage.addressing: paths(stage, params=False) for stage in stages}
    shown = [name for name, of in deps.items() if any(map(REPORT.is_relative_to, of))]
    assert [name.rpartition(":")[2].partition("@")[0] for name in shown] == ["report"]
    assert not [name for name, of in deps.items() if of & {"pipeline", "stages"}]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of pygtrie, within DVC
def test_dvc_repro_builds_every_stage(project: Path) -> None:
    """Without a target it builds the stages of the root's dvc.yaml and all before them."""
    last = {
        stage.path_in_repo
        for stage, dependents in Repo(project).index.graph.in_degree()
        if not dependents
    }
    assert last == {"dvc.yaml"}


def test_stages_have_names_and_commands_of_their_own(stages: list[PipelineStage]) -> None:
    """In dvc.lock a command is folded, and one with more blanks would run again for ever."""
    commands = [stage.cmd for stage in stages]
    assert len({stage.addressing for stage in stages}) == len({*commands}) == len(stages)
    assert not [command for command in commands if command != " ".join(command.split())]


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
