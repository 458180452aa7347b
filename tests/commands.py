"""Runs commands of `yearloc` in this process, and returns what they print."""

from typing import NamedTuple

import pytest

from pipeline.cli import main


class Command(NamedTuple):
    """A command with its first words, such as `localize` and a site."""

    capsys: pytest.CaptureFixture[str]
    words: tuple[object, ...] = ()

    def run(self, *words: object) -> tuple[str, str]:
        """Run the command with further words; returns standard output and standard error."""
        self.capsys.readouterr()
        main([str(word) for word in (*self.words, *words)])
        said = self.capsys.readouterr()
        return said.out, said.err

    def refused(self, *words: object) -> str:
        """Run the command with words that it refuses; returns the last line of standard error."""
        with pytest.raises(SystemExit) as stop:
            main([str(word) for word in (*self.words, *words)])
        assert stop.value.code == 1
        *_, line = self.capsys.readouterr().err.splitlines()
        return line
