"""Shared by all tests: real recordings beside the project, and a chain that is built once."""

import json
import os
import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings
from xdist.scheduler import LoadFileScheduling

import stages  # noqa: F401 (before torch and numba are loaded: it sets where kernels are kept and how threads wait)
from tests.clone import ROOT, Clone, share_kernels

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")  # how long an example takes is the machine's doing

JOBS = "tests/test_sweep_jobs.py"
"""Modules whose tests take long and share only the chain."""
ORDER = (
    *("tests/test_chain.py", "tests/report", "tests/online", "tests/methods"),
    *("tests/test_own_data.py", "tests/test_dvc_session.py", "tests/test_sweep.py", JOBS),
)
"""Long tests come first, so that workers end together: the chain, the tests that do not need it,
the tests that need it; then all short tests."""


STRESS = '"2014-07-28-14-30-00": "all reversed", "2015-01-14-14-30-00": "bare, 2.5 m to the left", '
LESS = (
    ("conf/dataset/town.yaml", "tiny: {" + STRESS, "tiny: {"),
    ("conf/poses.yaml", "rounds: [5, 20]", "rounds: [8]"),
    ("conf/poses.yaml", "every_m: 5.0", "every_m: 20.0"),
    ("conf/poses.yaml", "enough: 150", "enough: 10"),
)
"""What is left out of the chain: one stress day is enough, and nothing is significant in so small
a world."""


class ByFile(LoadFileScheduling):  # type: ignore[misc]
    """Gives each file to one worker, which makes its fixtures once, and tests of JOBS one by
    one."""

    def _split_scope(self, nodeid: str) -> str:
        return nodeid if nodeid.startswith(JOBS) else super()._split_scope(nodeid)


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> ByFile:
    config.option.loadscopereorder = False
    return ByFile(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> int:
        ranks = (row for row, start in enumerate(ORDER) if item.nodeid.startswith(start))
        return next(ranks, len(ORDER))

    items.sort(key=rank)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--seeds",
        type=int,
        default=1,
        help="train with so many seeds, and print each test's smallest margin",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    trains = metafunc.definition.get_closest_marker("learning")
    if (
        trains
        and "seed" in metafunc.fixturenames
        and (seeds := metafunc.config.getoption("seeds")) > 1
    ):
        metafunc.parametrize(
            "seed", range(seeds), indirect=True, ids="seed{}".format, scope="session"
        )


@pytest.fixture(scope="session")
def seed(request: pytest.FixtureRequest) -> int:
    """The seed that a test trains with; with `--seeds N` each test runs once with each of N."""
    return getattr(request, "param", 0)


@pytest.fixture
def clears(record_property: Callable[[str, object], None]) -> Callable[[float, float], None]:
    """Assert that a learned score lies above a bar, and note the margin."""

    def check(value: float, bar: float) -> None:
        record_property("margin", (float(value), bar))
        assert value > bar

    return check


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """The smallest margin of each test over all seeds."""
    if config.getoption("seeds") == 1:
        return
    margins: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for outcome in ("passed", "failed"):
        for report in terminalreporter.getreports(outcome):
            test = re.sub(r"\[seed\d+\]|(?<=\[)seed\d+-|-seed\d+(?=\])", "", report.nodeid)
            margins[test] += [
                tuple(value) for name, value in report.user_properties if name == "margin"
            ]
    terminalreporter.section(f"smallest margins over {config.getoption('seeds')} seeds")
    for test, found in sorted(margins.items()):
        for bar in sorted({bar for _, bar in found}):
            worst = min(value for value, own in found if own == bar)
            terminalreporter.write_line(f"{worst:7.3f} over {bar:6.3f}  {test}")


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real recordings; a test that needs it is skipped where it is absent."""
    folder = Path(__file__).parents[1].parent / "shared" / "real"
    if not folder.is_dir():
        pytest.skip(f"real recordings are not at {folder}")
    return folder


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A worker's own copy of the chain of tiny worlds, which DVC builds once.

    A test that edits it restores it.
    """
    alone = "PYTEST_XDIST_WORKER" not in os.environ
    shared = tmp_path_factory.getbasetemp() if alone else tmp_path_factory.getbasetemp().parent
    reported = shared / "chain.json"
    with FileLock(shared / "chain.lock"):
        if not reported.is_file():
            (shared / "chain").mkdir()
            clone = Clone(shared / "chain")
            clone.draw_small()
            for path, old, new in LESS:
                clone.edit(path, old, new)
            use = "methods=sci,scan_context,sad variants= poses=scan_context paths=filter,graph_all"
            clone.run("yearloc", "use", "campus", "world=tiny", *use.split())
            use = "experiment=robustness methods=sci,scan_context variants=engaged perturbed=turned cells=5m"
            clone.run("yearloc", "use", "town", "world=tiny", *use.split(), "--add")
            use = "experiment=viewpoints methods=sad"
            clone.run("yearloc", "use", "suburb", "world=tiny", *use.split(), "--add")
            share_kernels(clone.folder, ROOT)
            reported.write_text(json.dumps({"ran": clone.repro(), "undisturbed": clone.digests()}))
    return Clone(shared / "chain", reported.read_text()).twin(tmp_path_factory.mktemp("copy"))
