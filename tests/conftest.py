"""What all tests share: real recordings beside the project, and a chain built once."""

import os
from pathlib import Path

import pytest
from xdist.scheduler import LoadScopeScheduling

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # two workers on two cores: torch's threads must not spin

import stages  # noqa: F401 (numba caches by source from the first import on)
from tests.clone import Clone

BUILT = ("tests/test_chain.py", "tests/test_sweep.py")
"""Files whose tests look at the built chain."""


class OneChain(LoadScopeScheduling):  # type: ignore[misc]
    """Tests of the built chain share one worker, so that it is built once (xdist's own groups do not hold with pytest 9)."""

    def _split_scope(self, nodeid: str) -> str:
        return "chain" if nodeid.startswith(BUILT) else nodeid


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> OneChain:
    return OneChain(config, log)


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
