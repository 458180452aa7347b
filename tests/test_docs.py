"""References in code and pages exist: sections of METHODS, targets of links, commands, modules and
files of conf/."""

import importlib.util
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from pipeline.cli import app
from pipeline.core.errors import ConfigError
from pipeline.evaluation.rows import COLUMNS
from pipeline.studies.proposal import propose
from tests import messages

ROOT = Path(__file__).parents[1]
FOLDERS = ("pipeline", "stages", "worlds", "conf", "benchmarks", "docs", "tests")
CITING = [
    path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".yaml", ".md"}
]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*sorted(ROOT.glob("*.md")), *DOCS]
NUMBER = r"\d+(?:\.\d+)?"
CITATION = re.compile(rf"METHODS(?:\.md)?\s+({NUMBER}(?:(?:,| and| to)\s+{NUMBER})*)")
FENCED = re.compile(r"```.*?```", re.DOTALL)
CODE = re.compile(r"`[^`\n]*`")
BLOCK = re.compile(r"^[ ]*```\w*\n(.*?)^[ ]*```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
NAMED = re.compile(
    r"(?:\.github|benchmarks|conf|dag|docs|examples|pipeline|stages|tests|worlds)/[\w./-]*"
)
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
YEARLOC: Any = get_command(app)
COMMANDS = YEARLOC.commands
OPTIONS = {"--help", *(option for parameter in YEARLOC.params for option in parameter.opts)}
PLACEHOLDER = re.compile(r"\b[A-Z]{4,}\b|…")
"""DATE, NAME or STUDY: words that a reader replaces."""
LOADED = re.compile(r"""<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//""")


def cited(text: str) -> list[str]:
    """Sections that a text refers to: `METHODS 7.2, 2.9` is two."""
    return [number for found in CITATION.findall(text) for number in re.findall(NUMBER, found)]


def sections(text: str) -> set[str]:
    return set(re.findall(rf"^#+ ({NUMBER})\b", text, re.MULTILINE))


def anchors(text: str) -> set[str]:
    """The anchors that GitHub makes of headings."""
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def split(lines: Iterable[str]) -> list[list[str]]:
    """The words of each of our commands in lines of a shell."""
    found = []
    for line in lines:
        if re.match(r"\s*(yearloc|make|python) ", line):
            words = shlex.split(line, comments=True)
            ends = [
                -1,
                *(row for row, word in enumerate(words) if word in ("&&", "||", "|")),
                len(words),
            ]
            found += [words[start + 1 : end] for start, end in pairwise(ends)]
    return found


def commands(page: Path) -> list[list[str]]:
    """The commands in the code blocks of a page."""
    return split(
        line
        for block in BLOCK.findall(page.read_text())
        for line in block.replace("\\\n", " ").splitlines()
    )


def mentioned(page: Path) -> list[list[str]]:
    """Commands in the sentences of a page, perhaps without required options."""
    codes = CODE.findall(FENCED.sub("", page.read_text()))
    return split(code[1:-1] for code in codes if not PLACEHOLDER.search(code))


def check_use(words: list[str]) -> None:
    """Raise ConfigError for an unknown data set or option; data at `root` are not needed."""
    options = dict(word.split("=", 1) for word in words if "=" in word)
    for name in (word for word in words if "=" not in word):
        known = (
            name
            if (ROOT / f"conf/dataset/{name}.yaml").is_file()
            else {"robot": "bag"}.get(name, name)
        )
        try:
            propose(
                ROOT / "conf",
                known,
                {key: value.replace("NAME", "m2dp") for key, value in options.items()},
            )
        except ConfigError as error:
            if not re.match(r"root=|where is ", str(error)):
                raise


def check(words: list[str]) -> None:
    """Fail unless the command's parser, or the Makefile, knows all of its words."""
    if words[0] == "make":
        assert {word for word in words[1:] if "=" not in word} <= TARGETS, words
    elif words[:2] == ["python", "-m"]:
        place = ROOT / words[2].replace(".", "/")
        own = place.with_suffix(".py").is_file() or (place / "__main__.py").is_file()
        package = words[2].partition(".")[0]
        assert own or (not (ROOT / package).exists() and importlib.util.find_spec(package)), words
    elif words[0] == "python" and not words[1].startswith("-"):
        assert (ROOT / words[1]).is_file(), words
    elif words[0] == "yearloc":
        assert words[1] in COMMANDS, words
        given = COMMANDS[words[1]].make_context(words[1], words[2:]).params
        if words[1] == "use":
            check_use(given["words"])
        if words[1] == "results" and given["where"]:
            conditions = [*given["where"], *given["words"]]
            assert {word.partition("=")[0] for word in conditions} <= {*COLUMNS}, words


def test_every_section_that_is_cited_exists() -> None:
    known = sections((ROOT / "docs/METHODS.md").read_text())
    assert not [
        (path, number)
        for path in CITING
        for number in cited(path.read_text())
        if number not in known
    ]


def test_links_lead_to_files_and_headings() -> None:
    links = [
        (page, *target.partition("#")[::2])
        for page in PAGES
        for target in LINK.findall(CODE.sub("", FENCED.sub("", page.read_text())))
        if "://" not in target and not target.startswith("mailto:")
    ]
    headings = {page: anchors(page.read_text()) for page in PAGES}
    assert len(links) > len(PAGES)
    for page, name, anchor in links:
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), (page, name)
        assert not anchor or anchor in headings[file], (page, name, anchor)


def test_messages_of_the_code_are_those_of_troubleshooting() -> None:
    page = messages.PAGE.read_text()
    present = messages.written(page, messages.sources(), messages.TEMPLATES.read_text())
    same = present == page  # pytest would take a minute to lay out how they differ
    assert same, "`python -m tests.messages` writes docs/troubleshooting.md"


def test_the_table_of_contents_has_every_page_and_no_other() -> None:
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
    listed = re.findall(r"[\w/-]+\.md", str(site["nav"]))
    assert len(listed) == len(set(listed))
    assert {*listed} == {str(page.relative_to(ROOT / "docs")) for page in DOCS}


def test_commands_can_be_typed() -> None:
    in_blocks = [words for page in PAGES for words in commands(page)]
    assert len(in_blocks) > len(PAGES)
    for words in in_blocks:
        check(words)
    for words in (words for page in PAGES for words in mentioned(page)):
        if words[0] == "yearloc":
            assert words[1] in {*COMMANDS, *OPTIONS}, words
        else:
            check(words)


def test_files_that_are_named_exist() -> None:
    codes = {
        code[1:-1]
        for page in PAGES
        for code in CODE.findall(FENCED.sub("", page.read_text()))
        if NAMED.match(code[1:]) and not PLACEHOLDER.search(code)
    }
    names = {re.split(r"[\s:]", code)[0].rstrip("/") for code in codes}
    assert len(names) > len(PAGES)
    assert not [name for name in names if not any(ROOT.glob(name))]


def test_the_pages_build_and_load_nothing_from_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="pip install '.[docs]'")
    pytest.importorskip("material", reason="pip install '.[docs]'")
    built = subprocess.run(
        [
            sys.executable,
            "-m",
            "mkdocs",
            "build",
            "--strict",
            "--quiet",
            "--site-dir",
            str(tmp_path),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    pages = sorted(tmp_path.rglob("*.html"))
    assert len(pages) > len(DOCS)
    assert not [(page.name, found) for page in pages for found in LOADED.findall(page.read_text())]
