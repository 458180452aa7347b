"""A file of conf/ that cannot be read is an error in one line; commands print in any locale."""

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation.rows import row, table
from pipeline.running.texts import check_files, folded, read_yaml
from tests.clone import Clone

BROKEN = {
    "missing": None,
    "empty": b"",
    "bytes": b"studies: \xff\xfe\n",
    "zeros": bytes(64),
    "slip": b"studies: [\n",
    "list": b"- a\n- b\n",
    "word": b"campus\n",
}
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}


def broken(path: Path, how: str) -> None:
    """Replace a file by one of BROKEN."""
    path.unlink()
    if (content := BROKEN[how]) is not None:
        path.write_bytes(content)


@pytest.mark.parametrize("how", BROKEN)
def test_a_file_that_cannot_be_read_is_named_with_what_to_do(tmp_path: Path, how: str) -> None:
    (path := tmp_path / "a.yaml").touch()
    broken(path, how)
    with pytest.raises(
        ConfigError, match=r"^\S+a\.yaml: [^\n]*; fix it, or let `git checkout` bring it back$"
    ):
        read_yaml(path)
    with pytest.raises(ConfigError, match=r"(a|lists)\.yaml"):
        check_files(tmp_path)


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A clone with a study of a tiny campus and a table of results made by hand."""
    clone = Clone(tmp_path_factory.mktemp("clone"))
    clone.run("yearloc", "use", "campus", "world=tiny", "methods=sci")
    (folder := clone.folder / "artifacts/results/campus").mkdir(parents=True)
    rows = [
        row("auc_top1", "cells", 0.5, 0.25, 0.75)
        | {"method": "sci", "sequence": "2012-02-04", "days": 20.0}
    ]
    table(rows, study="campus", dataset="campus", simulated=True, grid="10m").to_csv(
        folder / "results.csv", index=False
    )
    (report := clone.folder / "artifacts/report/campus/10m").mkdir(parents=True)
    (report / "results.txt").write_text("sci – 0.5 ± 0.25 → ° …\n", encoding="utf-8")
    return clone


def ended(clone: Clone, *words: str, **env: str) -> subprocess.CompletedProcess[bytes]:
    """Run Python with these words in the clone."""
    return subprocess.run(
        [sys.executable, *words], cwd=clone.folder, env=clone.env | env, capture_output=True
    )


LOGS = (
    "-m",
    "stages.logs",
    "dataset=campus",
    "world=campus_tiny",
    "sequence=2012-01-15",
    "root=artifacts/logs/campus",
    "out=out",
)


@pytest.mark.parametrize(
    ("how", "file", "words"),
    [
        ("missing", "logs", LOGS),
        ("bytes", "world/campus_tiny", LOGS),
        ("empty", "studies", ("-m", "stages.sweep", "grid.cell_m=5,10")),
        ("bytes", "method/sci", ("-m", "stages.sweep", "grid.cell_m=5,10")),
    ],
)
def test_a_stage_names_a_file_of_conf_that_cannot_be_read(
    clone: Clone, how: str, file: str, words: tuple[str, ...]
) -> None:
    before = (path := clone.folder / f"conf/{file}.yaml").read_bytes()
    broken(path, how)
    done = ended(clone, *words)
    path.write_bytes(before)
    said = done.stderr.decode()
    assert done.returncode == 1, said
    assert said.count("\n") == 1
    assert file in said


@pytest.mark.parametrize(
    "words", ["methods", "results --json", "use café", "pack campus/10m/café -o é.site"]
)
def test_no_command_ends_in_a_traceback_where_only_ascii_can_be_printed(
    clone: Clone, words: str
) -> None:
    done = ended(clone, "-m", "pipeline.cli", *words.split(), **ASCII)
    assert done.stdout.isascii()
    assert b"Traceback" not in done.stderr
    assert done.returncode == ("café" in words), done.stderr


@pytest.mark.slow
def test_a_stage_reads_utf_8_where_the_locale_is_ascii(clone: Clone) -> None:
    done = ended(clone, *LOGS, **ASCII)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False), done.stderr


def test_results_in_ascii_are_the_same_but_for_a_question_mark_where_it_lacks_a_character(
    clone: Clone,
) -> None:
    words = ("-m", "pipeline.cli", "results", "--full")
    in_utf8 = ended(clone, *words).stdout.decode()
    in_ascii = ended(clone, *words, **ASCII).stdout.decode()
    assert in_utf8.translate(dict.fromkeys(map(ord, "–±→°…"), "?")) == in_ascii


TABLE = """campus, simulated, trained on 2012-01-15

Area under the curve, by cells, of all the days
method        february       may
────────────  ────────  ────────
scan_context     0.800      0.70
sci              0.900     0.750
"""


def test_columns_that_do_not_fit_the_terminal_go_on_below_and_other_lines_wrap() -> None:
    assert folded(TABLE, 60) == TABLE
    assert (
        folded(TABLE, 28)
        == """campus, simulated, trained
on 2012-01-15

Area under the curve, by
cells, of all the days
method        february
────────────  ────────
scan_context     0.800
sci              0.900

method             may
────────────  ────────
scan_context      0.70
sci              0.750"""
    )
    assert max(map(len, folded(TABLE, 5).splitlines())) == 22  # a column is never cut


@pytest.mark.parametrize("words", ["results --full", "methods"])
def test_in_40_columns_no_line_is_longer(clone: Clone, words: str) -> None:
    (text := clone.folder / "artifacts/report/campus/10m/results.txt").write_text(
        TABLE + "\n" + TABLE.replace("may", "may " * 9)
    )
    done = ended(clone, "-m", "pipeline.cli", *words.split(), COLUMNS="40")
    lines = done.stdout.decode().splitlines()
    assert done.returncode == 0, done.stderr
    assert [line for line in lines if len(line) > 40 and " " in line and ": " not in line] == []
    text.unlink()
    text.write_text("sci – 0.5 ± 0.25 → ° …\n", encoding="utf-8")
