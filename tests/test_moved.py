"""A project that was moved or copied with its .venv, whose scripts name the old folder."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CONFIG = "home = /usr/bin\nversion = 3.11.7\ncommand = /usr/bin/python3 -m venv {}\n"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """One that is installed."""
    project = tmp_path / "my clone"
    (project / ".venv").mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, project)
    (project / ".venv/pyvenv.cfg").write_text(CONFIG.format(project / ".venv"))
    (project / ".venv/ready").touch()
    return project


def made(folder: Path, target: str = "install") -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", "--dry-run", target], cwd=folder, capture_output=True, text=True)


def test_a_project_where_it_was_installed_is_made(project: Path) -> None:
    assert made(project).returncode == 0
    (project.parent / "link").symlink_to(project)
    assert made(project.parent / "link").returncode == 0


def test_a_moved_or_a_copied_project_says_what_to_do(project: Path) -> None:
    copied = shutil.copytree(project, project.parent / "copied")
    moved = project.rename(project.parent / "moved")
    project.mkdir()
    for folder in (copied, moved):
        done = made(folder)
        assert done.returncode == 2
        line = done.stderr.strip()
        assert (
            f".venv was made in {project}, and this folder was moved or copied from there: `rm -r "
            ".venv`" in line
        )
        assert len(line.splitlines()) == 1
        assert made(folder, "clean").returncode == 0


def test_a_venv_by_another_name_or_from_another_tool_is_left_alone(project: Path) -> None:
    for config in (CONFIG.format("/opt/venvs/yearloc"), "home = /usr/bin\nuv = 0.9\n"):
        (project / ".venv/pyvenv.cfg").write_text(config)
        assert made(project).returncode == 0
    (project / ".venv/pyvenv.cfg").unlink()
    assert made(project).returncode == 0
