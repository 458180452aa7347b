"""What all tests share: real recordings beside the project."""

from pathlib import Path

import pytest

import stages  # noqa: F401 (numba caches by source from the first import on)


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real recordings; a test that needs it is skipped where it is absent."""
    folder = Path(__file__).parents[1].parent / "shared" / "real"
    if not folder.is_dir():
        pytest.skip(f"real recordings are not at {folder}")
    return folder
