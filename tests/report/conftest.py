"""One small study for all tests of the report."""

from pathlib import Path

import pytest

from pipeline.report.study import StudyResults
from tests.report import studied


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    """The study of `studied`, whose artifacts lie on the disk."""
    return studied.build(Path(tmp_path_factory.mktemp("study"), "artifacts"))
