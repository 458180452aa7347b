"""The site of three places, and the commands that use it."""

from pathlib import Path

import pytest

from tests.commands import Command
from tests.online.made import packed


@pytest.fixture(scope="session")
def three_places(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the site of three places."""
    return packed(tmp_path_factory.mktemp("site"))


@pytest.fixture
def yearloc(capsys: pytest.CaptureFixture[str]) -> Command:
    """Any command."""
    return Command(capsys)
