"""What all tests share: real recordings beside the project, and a chain built once."""

import json
import os
from pathlib import Path

import pytest
from filelock import FileLock
from xdist.scheduler import LoadScopeScheduling

import stages  # noqa: F401 (before torch and numba are loaded: it sets where kernels are kept and how threads wait)
from pipeline.running.repair import repair
from tests.clone import ROOT, Clone

repair(ROOT)  # DVC wants the lock files that its links lead to; a fresh clone has none

CHAIN, SWEEP = "tests/test_chain.py", "tests/test_sweep.py"
"""Each goes to one worker, as its tests share what the first of them builds."""
LONG = ("tests/test_repair.py", "tests/test_sweep_jobs.py")
"""Each test alone, and at the end: they need the built chain, and take up to minutes."""


class Shared(LoadScopeScheduling):  # type: ignore[misc]
    """Whole files for CHAIN and SWEEP (xdist's own groups do not hold with pytest 9), other tests one by one."""

    def _split_scope(self, nodeid: str) -> str:
        return next((file for file in (CHAIN, SWEEP) if nodeid.startswith(file)), nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Shared:
    config.option.loadscopereorder = False
    return Shared(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The chain first, then what needs no chain, then what waits for it."""
    order = (CHAIN, "", SWEEP, *LONG)
    items.sort(key=lambda item: next((rank for rank, file in enumerate(order) if file and item.nodeid.startswith(file)), 1))


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real recordings; a test that needs it is skipped where it is absent."""
    folder = Path(__file__).parents[1].parent / "shared" / "real"
    if not folder.is_dir():
        pytest.skip(f"real recordings are not at {folder}")
    return folder


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A worker's own copy of the chain of tiny worlds, which DVC builds once. Whoever edits it puts it back."""
    alone = "PYTEST_XDIST_WORKER" not in os.environ
    shared = tmp_path_factory.getbasetemp() if alone else tmp_path_factory.getbasetemp().parent
    told = shared / "chain.json"
    with FileLock(shared / "chain.lock"):
        if not told.is_file():
            (shared / "chain").mkdir()
            clone = Clone(shared / "chain")
            clone.run(
                "yearloc",
                "use",
                "campus",
                "world=tiny",
                "methods=sci,scan_context,sad",
                "poses=scan_context",
                "paths=filter,graph_all",
            )
            robust = ("question=robustness", "methods=sci,scan_context", "variants=engaged", "altered=turned", "cells=5m")
            clone.run("yearloc", "use", "town", "world=tiny", *robust, "--add")
            clone.run("yearloc", "use", "suburb", "world=tiny", "question=viewpoints", "methods=sad", "--add")
            clone.edit("conf/poses.yaml", "rounds: [5, 20, 20]", "rounds: [20]")  # nothing is clear in so small a world
            told.write_text(json.dumps({"ran": clone.repro(), "undisturbed": clone.digests()}))
    return Clone(shared / "chain", told.read_text()).twin(tmp_path_factory.mktemp("copy"))
