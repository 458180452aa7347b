"""Copies of the project in which tests run DVC and sweeps."""

import json
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from copy import copy
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp

from numba.core.caching import UserProvidedCacheLocator

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
PROJECT = (
    *("conf", "pipeline", "stages", "worlds", "dag", "dvc.yaml", "pyproject.toml"),
    *(".dvc/config", ".dvc/plots", ".dvc/.gitignore", ".dvcignore", ".gitignore"),
)


def name_of(address: str) -> str:
    """The stage train@campus-10m-sci of DVC's address dag/train/dvc.yaml:train@campus-10m-sci."""
    return address.rpartition(":")[2]


def stages_run(out: str) -> list[str]:
    """The stages that DVC ran, by what it printed."""
    running = [line for line in out.splitlines() if line.startswith("Running stage")]
    return [name_of(line.split("'")[1]) for line in running]


def share_kernels(compiled: Path, copy: Path) -> None:
    """Give a copy of the project, or the project itself, the kernels compiled for another copy.

    numba keeps them in a folder that is named by the path of their source.
    """
    kernels = Path(os.environ["NUMBA_CACHE_DIR"])
    for source in (*compiled.glob("pipeline/**/*.py"), *compiled.glob("worlds/**/*.py")):
        copied_source = copy / source.relative_to(compiled)
        folder, folder_of_copy = (
            kernels / UserProvidedCacheLocator.get_suitable_cache_subpath(str(path))
            for path in (source, copied_source)
        )
        if folder.is_dir() and not folder_of_copy.exists():
            scratch = Path(mkdtemp(dir=kernels))
            shutil.copytree(folder, scratch, ignore_dangling_symlinks=True, dirs_exist_ok=True)
            try:
                scratch.rename(folder_of_copy)
            except OSError:  # another process compiled it meanwhile
                shutil.rmtree(scratch)


class Clone:
    """A copy of the project to run DVC in, without git unless it is asked for."""

    def __init__(self, folder: Path, built: str | None = None, git: bool = False) -> None:
        """Copy the project into `folder`; or use what lies there, if `built` says how it was built.

        `built` is JSON with the attributes `ran` and `undisturbed`.
        """
        self.folder = folder
        attributes = json.loads(built or "{}")
        self.ran: list[str] = attributes.get("ran", [])
        self.undisturbed: dict[str, str] = attributes.get("undisturbed", {})
        if built:
            return
        for name in filter(lambda name: (ROOT / name).exists(), PROJECT):
            if (ROOT / name).is_dir():
                shutil.copytree(
                    ROOT / name,
                    folder / name,
                    ignore=shutil.ignore_patterns("dvc.lock", "__pycache__"),
                )
            else:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        if git:
            self.git("init", "--quiet", "--initial-branch=main")
        else:
            config = folder / ".dvc/config"
            config.write_text(config.read_text().replace("[core]", "[core]\n    no_scm = true"))
        share_kernels(ROOT, folder)

    @property
    def env(self) -> dict[str, str]:
        """The environment of its commands."""
        path = f"{BIN}:{os.environ['PATH']}"
        return os.environ | {
            "PATH": path,
            "PYTHONPATH": str(self.folder),
            "PYTHONWARNINGS": "default",
        }

    def twin(self, folder: Path) -> "Clone":
        """A copy of this clone in another folder, with all that it has built."""
        other = copy(self)
        other.folder = shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        share_kernels(self.folder, folder)
        if (folder / "mlflow.db").is_file():  # it knows where its figures are
            with closing(sqlite3.connect(folder / "mlflow.db")) as database:
                for table, column in (
                    ("experiments", "artifact_location"),
                    ("runs", "artifact_uri"),
                ):
                    database.execute(
                        f"update {table} set {column} = replace({column}, ?, ?)",
                        (str(self.folder), str(folder)),
                    )
                database.commit()
        return other

    def git(self, *words: str) -> str:
        """Run git as the author nobody; returns what it prints."""
        who = ("-c", "user.name=nobody", "-c", "user.email=nobody@localhost")
        done = subprocess.run(
            ["git", *who, *words], cwd=self.folder, capture_output=True, text=True, check=True
        )
        return done.stdout

    def run(self, *command: str) -> str:
        done = subprocess.run(
            [str(BIN / command[0]), *command[1:]],
            cwd=self.folder,
            env=self.env,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def repro(self) -> list[str]:
        """Run `dvc repro`; returns the stages that ran."""
        return stages_run(self.run("dvc", "repro"))

    def outdated(self) -> set[str]:
        """The stages that an edit touched directly."""
        return set(map(name_of, json.loads(self.run("dvc", "status", "--json"))))

    def digests(self) -> dict[str, str]:
        """Every file of every artifact, with the digest of its bytes."""
        files = [path for path in (self.folder / "artifacts").rglob("*") if path.is_file()]
        return {
            str(path.relative_to(self.folder)): sha256(path.read_bytes()).hexdigest()
            for path in files
        }

    def draw_small(self) -> None:
        """Draw Scan Contexts of 16 × 48, on which a network trains six times as fast."""
        for size, less in (("rings: 40", "rings: 16"), ("sectors: 120", "sectors: 48")):
            for view in ("scan_context", "scan_context_authors"):
                self.edit(f"conf/view/{view}.yaml", size, less)

    def edit(self, path: str, old: str, new: str) -> str:
        before = (self.folder / path).read_text()
        assert old in before
        (self.folder / path).write_text(before.replace(old, new))
        return before
