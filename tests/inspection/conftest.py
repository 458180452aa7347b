"""Inspections in a folder of their own."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _no_dvc_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The project's own dvc.lock is long to read, and knows nothing of these files."""
    monkeypatch.chdir(tmp_path)
