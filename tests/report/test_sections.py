"""Each word that the report uses is in words.yaml, none is unused, and none names a method."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import yaml

from pipeline.report import render

REPORT = Path(render.__file__).parent
WORDS = yaml.safe_load((REPORT / "templates/words.yaml").read_text())
METHODS = "|".join(path.stem for path in (Path(__file__).parents[2] / "conf/method").glob("*.yaml"))
TREES = [ast.parse(path.read_text()) for path in REPORT.rglob("*.py")]
NODES = [node for tree in TREES for node in ast.walk(tree)]
MADE = {
    "tables": {
        "by_cells_recall_at_1",
        "by_cells_auc_top1",
        "by_cells_auroc",
        "main_recall_at_1",
        "main_auc_top1",
        "viewpoints_over_seeds",
        "viewpoints_over_headings",
        "poses",
        "posed",
        "pose_answers",
    },
    "findings": {"incremental_forgets", "below_joint"},
    "figures": {
        "novelty",
        "rejection",
        "reliability",
        "matches",
        "verdicts",
        "probabilities",
        "failures",
    },
    "sections": {"turned", "demolition", "construction"},
}
"""Kinds that are put together of several words, named by a perturbation, or made in a loop."""


def strings() -> Iterator[str]:
    """All strings in the code of the report, but its docstrings."""
    reported = {id(node.value) for node in NODES if isinstance(node, ast.Expr)}
    yield from (
        n.value
        for n in NODES
        if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in reported
    )


def kinds(group: str) -> set[str]:
    """The kinds of a group that the code names, as the argument of what makes one."""
    makers = {
        "findings": ("Finding",),
        "tables": ("table", "pivot"),
        "figures": ("Illustration", "illustrate", "draw"),
        "sections": ("Section", "section_of", "_compared"),
    }
    calls = [
        n
        for n in NODES
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id in makers[group]
    ]
    skipped = {
        "Section": 1,
        "section_of": 1,
        "_compared": 1,
        "illustrate": 2,
    }  # arguments before the kind
    given = [call.args[skipped.get(call.func.id, 0)] for call in calls]
    return {one.value for one in given if isinstance(one, ast.Constant)} | MADE.get(group, set())


def test_every_kind_has_its_words_and_all_words_are_used() -> None:
    for group in ("findings", "tables", "figures", "sections"):
        assert kinds(group) == set(WORDS[group]), group
    used = {
        *strings(),
        *re.findall(
            r'words\("(?:page", ")?(\w+)"', "".join(p.read_text() for p in REPORT.rglob("*.j2"))
        ),
    }
    assert {*WORDS, *WORDS["page"]} - {"findings", "tables", "figures", "sections"} <= used | {
        "case"
    }


def test_no_method_is_named_in_code_or_words() -> None:
    named = re.compile(rf"(?<!\w)({METHODS})(?!\w)")  # the paper is SCI, in capitals
    assert [text for text in strings() if named.search(text)] == []
    assert named.findall((REPORT / "templates/words.yaml").read_text()) == []
