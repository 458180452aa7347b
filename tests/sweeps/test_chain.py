"""A sweep reads dvc.yaml, and those in dag/, as DVC itself does."""

from pathlib import Path

import pytest
import yaml
from dvc.repo import Repo

from pipeline.core.errors import ConfigError
from pipeline.running.dvc_files import definition
from pipeline.studies.expansion import expand as expand_studies
from pipeline.studies.study import Study
from pipeline.sweeps.chain import code, expand, inputs, producers

ROOT = Path(__file__).parents[2]
DEFINITION = definition(ROOT)
STUDIES, LISTS = (
    yaml.safe_load((ROOT / f"conf/{name}.yaml").read_text())[name] for name in ("studies", "lists")
)
STEPS = expand(DEFINITION, LISTS)


def dependencies(deps: list[object], are_params: bool) -> list[object]:
    """Those of DVC's dependencies that are parameters, or those that are files."""
    return [dep for dep in deps if (type(dep).__name__ == "ParamsDependency") == are_params]


def test_every_stage_is_the_one_that_dvc_finds() -> None:
    dvc_stages = {stage.cmd: stage for stage in Repo(ROOT).index.stages}
    assert dvc_stages.keys() == {step.command for step in STEPS}
    for step in STEPS:
        stage = dvc_stages[step.command]
        files = dependencies(stage.deps, are_params=False)
        params = dependencies(stage.deps, are_params=True)
        assert {dep.def_path for dep in files} == set(step.deps)
        assert {dep.def_path: tuple(dep.params) for dep in params} == step.params
        assert {out.def_path for out in stage.outs} == set(step.outs)


def test_other_names_make_another_chain() -> None:
    other = {
        "tests": ["2013-04-05"],
        "grids": ["5m"],
        "methods": [{"name": "sci", "view": "scan_context_authors", "code": "c"}],
        "perturbed": {},
    }
    steps = expand(
        DEFINITION,
        expand_studies({"campus": Study.of(ROOT / "conf", "campus", STUDIES["campus"] | other)}),
    )
    (evaluate,) = [step for step in steps if step.stage == "evaluate"]
    assert evaluate.outs == ("artifacts/evaluate/campus/5m/sci", "artifacts/metrics/campus/5m/sci")
    assert evaluate.fields["sequences"] == "2013-04-05"
    (train,) = [step for step in steps if step.stage == "train"]
    assert "artifacts/views/campus/scan_context_authors/2012-01-15.zarr" in train.deps


def test_a_command_is_read_as_choices_of_files_and_fields() -> None:
    (step,) = [
        step for step in STEPS if step.stage == "labels" and step.overrides["dataset"] == "campus"
    ]
    assert step.choices == {"dataset": "campus", "grid": "10m"}
    train, *tests = STUDIES["campus"]["train"], *STUDIES["campus"]["tests"]
    assert step.fields == {
        "train": train,
        "sequences": " ".join((train, *tests)),
        "submaps": "artifacts/submaps/campus",
        "out": "artifacts/labels/campus/10m",
    }
    assert step.params["conf/dataset/campus.yaml"] == ("box",)


def test_inputs_are_artifacts_and_the_rest_is_code() -> None:
    step = next(step for step in STEPS if step.stage == "train")
    makers = inputs(step, producers(STEPS))
    assert {maker.stage for maker in makers.values()} == {"views", "labels"}
    assert Path("stages/train.py") in code(step)
    assert not makers.keys() & {path.as_posix() for path in code(step)}
    assert len(makers) + len(code(step)) == len(step.deps)


def test_a_folder_full_of_artifacts_is_the_input_of_whoever_reads_it() -> None:
    submaps = producers(STEPS)["artifacts/submaps/campus"]
    drives = [key for key in LISTS["drives"] if key.startswith("campus-")]
    assert (
        len(inputs(submaps, producers(STEPS))) == len(drives) == 1 + len(STUDIES["campus"]["tests"])
    )


def test_a_name_that_is_not_listed_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"\$\{lists.models\}"):
        expand(DEFINITION, {key: value for key, value in LISTS.items() if key != "models"})
