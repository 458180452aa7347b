"""What all tests share: real recordings beside the project, and a chain built once."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # two workers on two cores: torch's threads must not spin

import stages  # noqa: F401 (numba caches by source from the first import on)
from tests.clone import Clone


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of the built chain share one worker, so that it is built once."""
    for item in items:
        if "built" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("chain"))


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real recordings; a test that needs it is skipped where it is absent."""
    folder = Path(__file__).parents[1].parent / "shared" / "real"
    if not folder.is_dir():
        pytest.skip(f"real recordings are not at {folder}")
    return folder


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """The chain of the tiny world, built by DVC. Whoever edits it puts it back."""
    clone = Clone(tmp_path_factory.mktemp("chain"))
    clone.run("yearloc", "use", "campus", "world=tiny")
    clone.run("yearloc", "use", "town", "world=tiny", "methods=sci,scan_context", "--add")
    clone.run("yearloc", "use", "suburb", "world=tiny", "question=viewpoints", "methods=sad", "--add")
    clone.ran = clone.repro()
    clone.undisturbed = clone.digests()
    return clone
