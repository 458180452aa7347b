"""Without a terminal, as in a log file, progress is an occasional line instead of a bar."""

import pytest

from pipeline.cli import progress
from pipeline.cli.progress import Bar


def test_a_log_gets_a_line_now_and_then_and_none_of_work_that_is_soon_over(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four items of 4 s each: a line after the second, at 8 s, two more to come; at 12 s it is too
    soon for another, and at the end none is needed."""
    clock = iter([0.0, 4.0, 8.0, 12.0, 16.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    assert list(Bar().track("abcd", 4, "validation blocks")) == [*"abcd"]
    assert capsys.readouterr().err == "  validation blocks: 2 of 4, about 8 s left\n"
