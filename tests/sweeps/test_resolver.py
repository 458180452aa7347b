"""A job takes what it can from DVC and from the cache, and builds what its settings touch."""

import hashlib
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml

from pipeline.sweeps.chain import Step, expand
from pipeline.sweeps.lock import UpToDate, digest
from pipeline.sweeps.resolver import (
    ArtifactCache,
    ArtifactResolver,
    StepSettings,
    substituted_fields,
)

CHAIN = yaml.safe_load("""
stages:
  scans:
    cmd: python -m stages.scans root=artifacts/logs sequence='day' out=artifacts/scans/day.txt
    deps: [code/scans.py]
    params: [conf/scans.yaml: ]
    outs: [artifacts/scans/day.txt]
  views:
    cmd: python -m stages.views view=small scans=artifacts/scans/day.txt out=artifacts/views/day.txt
    deps: [code/views, artifacts/scans/day.txt]
    params: [conf/view/small.yaml: ]
    outs: [artifacts/views/day.txt]
  train:
    cmd: python -m stages.train views=artifacts/views/day.txt out=artifacts/train/model.txt log=artifacts/train/log.txt
    deps: [code/train.py, artifacts/views/day.txt]
    params: [conf/train.yaml: [rate]]
    outs: [artifacts/train/model.txt]
    metrics: [artifacts/train/log.txt]
""")


class Project:
    """A toy project of three stages, each of which writes its settings and inputs as its output."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.steps = expand(CHAIN, {})
        self.ran = list[str]()
        code = dict.fromkeys(("code/scans.py", "code/views/a.py", "code/train.py"), "1")
        conf = {
            "scans.yaml": "grain: 1\n",
            "view/small.yaml": "rings: 4\n",
            "train.yaml": "rate: 1\nother: 1\n",
        }
        for name, text in (code | {f"conf/{name}": text for name, text in conf.items()}).items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)

    def run(self, step: Step, fields: Mapping[str, str]) -> None:
        self.ran.append(step.stage)
        read = [
            Path(value).read_text() for key, value in fields.items() if key in ("scans", "views")
        ]
        for path in (Path(fields[key]) for key in ("out", "log") if key in fields):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{step.stage} {self.values(step)} of {read}")

    def values(self, step: Step, **changes: int) -> dict[str, int]:
        """A step's settings by the files in conf/, with those changes that it has a key for."""
        values: dict[str, int] = {}
        for file, keys in step.params.items():
            content = yaml.safe_load(Path(file).read_text())
            values |= {key: content[key] for key in keys} if keys else content
        return values | {key: value for key, value in changes.items() if key in values}

    def repro(self) -> None:
        """Run all steps, and write the dvc.lock that DVC would write."""
        stages = {}
        for step in self.steps:
            self.run(step, step.fields)
            files = {file: yaml.safe_load(Path(file).read_text()) for file in step.params}
            stages[step.stage] = {
                "cmd": step.command,
                "deps": [{"path": dep, "md5": digest(Path(dep))} for dep in step.deps],
                "params": {
                    file: {key: files[file][key] for key in keys or files[file]}
                    for file, keys in step.params.items()
                },
                "outs": [{"path": out, "md5": digest(Path(out))} for out in step.outs],
            }
        Path("dvc.lock").write_text(yaml.safe_dump({"schema": "2.0", "stages": stages}))
        self.ran.clear()

    def job(self, **changes: int) -> ArtifactResolver:
        """A job with these settings changed."""

        def settings(step: Step) -> StepSettings:
            values = self.values(step, **changes)
            return StepSettings(values, values == self.values(step))

        return ArtifactResolver(
            self.steps, UpToDate(self.root), ArtifactCache(Path(".sweeps")), settings, self.run
        )


MODEL = "artifacts/train/model.txt"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    monkeypatch.chdir(tmp_path)
    return Project(tmp_path)


def test_a_job_of_unchanged_settings_is_dvcs_own(project: Project) -> None:
    project.repro()
    job = project.job()
    assert (job.obtain(MODEL), job.counts["from_dvc"]) == (Path(MODEL), {"train": 1})
    assert project.ran == []


def test_a_setting_costs_what_lies_after_it(project: Project) -> None:
    project.repro()
    job = project.job(rings=8)
    assert "train {'rate': 1} of" in job.obtain(MODEL).read_text()
    assert project.ran == ["views", "train"]
    assert job.counts["from_dvc"] == {"scans": 1}
    assert job.counts["built"] == {"views": 1, "train": 1}
    assert job.obtain(MODEL).is_relative_to(".sweeps/train")


def test_a_tiny_number_is_the_same_in_the_lock_and_in_conf(project: Project) -> None:
    Path("conf/train.yaml").write_text("rate: 0.00002\nother: 1\n")
    project.repro()
    Path("dvc.lock").write_text(
        Path("dvc.lock").read_text().replace("2.0e-05", "2e-05")
    )  # as DVC writes it
    project.job().obtain(MODEL)
    assert project.ran == []


def test_a_second_job_takes_all_from_the_first(project: Project) -> None:
    project.repro()
    first = project.job(rings=8).obtain(MODEL)
    project.ran.clear()
    job = project.job(rings=8)
    assert job.obtain(MODEL) == first
    assert job.counts == {"from_dvc": {}, "from_sweeps": {"train": 1}, "built": {}}
    assert project.ran == []
    assert project.job(rings=8, rate=2).obtain(MODEL) != first
    assert project.ran == ["train"]


def test_without_dvc_everything_is_built_and_the_same(project: Project) -> None:
    built = project.job().obtain(MODEL).read_text()
    assert project.ran == ["scans", "views", "train"]
    project.repro()
    assert Path(MODEL).read_text().replace("'", "") == built.replace("'", "")


@pytest.mark.parametrize(
    ("path", "text", "ran"),
    [
        ("code/train.py", "2", ["train"]),
        ("code/views/a.py", "2", ["views", "train"]),
        ("code/views/b.py", "new", ["views", "train"]),
        ("conf/view/small.yaml", "rings: 5\n", ["views", "train"]),
        ("conf/train.yaml", "rate: 2\nother: 1\n", ["train"]),
        ("conf/train.yaml", "rate: 1\nother: 2\n", []),  # a key that does not count
        ("code/views/__pycache__/a.pyc", "bytes", []),
        ("dvc.lock", "torn: [", ["scans", "views", "train"]),
        ("artifacts/train/model.txt", "damaged", ["train"]),
        ("artifacts/views/day.txt", "damaged, but what was made of it before is whole", []),
    ],
)
def test_an_edit_since_the_last_repro_is_seen(
    project: Project, path: str, text: str, ran: list[str]
) -> None:
    project.repro()
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(text)
    project.job().obtain(MODEL)
    assert project.ran == ran


def test_a_damaged_input_is_not_read(project: Project) -> None:
    project.repro()
    Path("artifacts/views/day.txt").write_text("damaged")
    assert "damaged" not in project.job(rate=2).obtain(MODEL).read_text()
    assert project.ran == ["views", "train"]


@pytest.mark.parametrize(
    ("stands_for", "root"),
    [
        ({}, "artifacts/logs"),  # a step that makes no such artifact keeps it as it stands
        ({"artifacts/logs/day": ".sweeps/logs/k/day"}, ".sweeps/logs/k"),
        ({"artifacts/logs/day": "x/day", "artifacts/logs/night": "x/night"}, "x"),
        (
            {"artifacts/logs/day": "x/day", "artifacts/logs/night": "y/night"},
            "day at x/day and night at y/night",
        ),
        ({"artifacts": "elsewhere"}, "elsewhere/logs"),  # a part of one artifact
    ],
)
def test_a_folder_of_artifacts_is_where_they_are(
    project: Project, stands_for: dict[str, str], root: str
) -> None:
    def gathered(parts: Mapping[str, str]) -> str:
        return " and ".join(f"{name} at {path}" for name, path in sorted(parts.items()))

    assert substituted_fields(project.steps[0], stands_for, gathered)["root"] == root


def test_artifacts_from_several_places_are_shown_in_one_folder(tmp_path: Path) -> None:
    parts = {"monday": str(tmp_path / "a"), "friday": str(tmp_path / "b")}
    for path in parts.values():
        Path(path).write_text(path)
    folder = ArtifactCache(tmp_path / "cache").gather(parts)
    assert ArtifactCache(tmp_path / "cache").gather(parts) == folder
    assert {name: (folder / name).read_text() for name in parts} == parts


def test_digests_are_those_of_dvc(tmp_path: Path) -> None:
    # A folder's is the md5 of the JSON list of its files, sorted by path.
    (tmp_path / "d/sub").mkdir(parents=True)
    (tmp_path / "d/b").write_text("2")
    (tmp_path / "d/sub/a").write_text("1")
    one, two = (hashlib.md5(text.encode()).hexdigest() for text in "12")
    listing = f'[{{"md5": "{two}", "relpath": "b"}}, {{"md5": "{one}", "relpath": "sub/a"}}]'
    assert digest(tmp_path / "d") == hashlib.md5(listing.encode()).hexdigest() + ".dir"
    assert digest(tmp_path / "d/b") == two
    assert digest(tmp_path / "none") is None


def test_what_dvc_has_is_known_before_anything_is_built(project: Project) -> None:
    _, views, train = project.steps
    assert not project.job().dvc_has(views)
    project.repro()
    assert project.job().dvc_has(train)
    assert [project.job(rate=2).dvc_has(step) for step in (views, train)] == [True, False]
    assert project.ran == []


BUILDER = """
import sys, time
from pathlib import Path
from pipeline.sweeps.resolver import ArtifactCache

def fill(folder):
    with (folder / "builders").open("a") as trace:
        trace.write("x")
    for name in ("a", "b"):
        time.sleep(0.02)
        (folder / name).write_text(folder.name * 1000)

for key in ("key0", "key1", "key2", "key3"):
    folder, _ = ArtifactCache(Path(sys.argv[1])).get("train", key, ("a", "b"), fill)
    assert all((folder / name).read_text() == key * 1000 for name in ("a", "b"))
"""
"""Builds four entries slowly, of two files each, with a mark for each builder; then reads them."""


def fill(folder: Path) -> None:
    """Build an entry whole."""
    for name in ("a", "b"):
        (folder / name).write_text(folder.name)


def killed(folder: Path) -> None:
    """Build half of an entry."""
    (folder / "a").write_text("k")
    raise KeyboardInterrupt


def test_half_an_entry_is_built_again_and_a_whole_one_is_not(tmp_path: Path) -> None:
    cache = ArtifactCache(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        cache.get("views", "k", ("a", "b"), killed)
    assert cache.get("views", "k", ("a", "b"), fill) == (tmp_path / "views/k", True)
    assert cache.get("views", "k", ("a", "b"), killed) == (tmp_path / "views/k", False)


def test_many_at_once_build_each_entry_once(tmp_path: Path) -> None:
    processes = [subprocess.Popen([sys.executable, "-c", BUILDER, str(tmp_path)]) for _ in range(4)]
    assert [process.wait() for process in processes] == [0] * 4
    assert [(tmp_path / f"train/key{key}/builders").read_text() for key in range(4)] == ["x"] * 4
