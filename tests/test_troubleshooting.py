"""Every message that the product can print stands in docs/troubleshooting.md, and nothing else
does."""

import re
from pathlib import Path

import pytest
import yaml

from tests.messages import WHOLE, Messages, templated, words

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/troubleshooting.md"
FOLDERS = ("pipeline", "stages")
WORDS = "pipeline/report/templates/words.yaml"


def said() -> dict[str, set[str]]:
    """Every message of the product, with where it is said."""
    files = [
        path.relative_to(ROOT)
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
    ]
    names = {path: ".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in files}
    found = Messages({name: (ROOT / path).read_text() for path, name in names.items()}).all()
    texts = yaml.safe_load((ROOT / WORDS).read_text())
    for text in (texts["findings"]["doubts"], texts["page"]["no_figure"]):
        for one in templated(text):
            if words(one) >= WHOLE:
                found.setdefault(one, set()).add(WORDS)
    return found


def entries(page: str) -> list[str]:
    """The messages in the first column of the tables that begin with a column `message`."""
    found = []
    table = False
    for line in page.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        table = bool(cells) and (table or cells[0] == "message")
        found += (
            [
                code.replace("\\|", "|").strip()
                for _, code in re.findall(r"(`+)(.+?)\1(?!`)", cells[0])
            ]
            if table
            else []
        )
    return found


@pytest.fixture(scope="module")
def messages() -> dict[str, set[str]]:
    return said()


def test_every_message_is_on_the_page(messages: dict[str, set[str]]) -> None:
    listed = set(entries(PAGE.read_text()))
    assert not {
        message: sorted(where) for message, where in messages.items() if message not in listed
    }


def test_every_message_on_the_page_can_still_be_met(messages: dict[str, set[str]]) -> None:
    listed = entries(PAGE.read_text())
    assert not [message for message in listed if message not in messages]
    assert len(listed) == len(set(listed))


def test_messages_known_to_be_printed_are_collected(messages: dict[str, set[str]]) -> None:
    for message in (
        "…: no such artifact; `dvc repro` builds it",  # raised
        # a warning
        "z points down: it hangs from z = … m to … m; every highest z is the ground's: turn it "
        "by (x, −y, −z)",
        "outside the poses' span",  # why a scan is left out
        "yearloc…: …; `yearloc… --help` shows what is needed",  # on standard error
        "its own threshold rejects every query",  # a doubt, of a template
        "a scan of more than … bytes",  # the server's
    ):
        assert message in messages
    assert len(messages) > 500


MADE_UP = {
    "made.up": """
from made.other import reason, refuse
class Reader:
    def open(self, path, wrong):
        advice = "fetch it anew" if wrong else f"look into {path.parent} first"
        if wrong:
            raise LogError(f"{path}: holds {len(wrong)} rows; {advice}")
        self.skipped["a reason to skip"] += 1
        found.warn(wrong, "first half, " "second half")
        print(f"stopped at {path}", file=sys.stderr)
        print("a result, no warning")
        notes = (f"{path}: read in part",)
        refuse(path, "handed to a helper")
        raise ConfigError(reason(path))
""",
    "made.other": """
def reason(path):
    return "the reason given elsewhere"
def refuse(path, why):
    raise LogError(f"{path}: {why}")
""",
}


def test_the_collector_follows_texts_through_names_helpers_and_modules() -> None:
    assert set(Messages(MADE_UP).all()) == {
        "…: holds … rows; …",
        "fetch it anew",
        "look into … first",
        "a reason to skip",
        "first half, second half",
        "stopped at …",
        "…: read in part",
        "handed to a helper",
        "the reason given elsewhere",
    }


def test_branches_of_a_template_are_messages_of_their_own() -> None:
    text = (
        "{% if a %}{{ share | percent }} of the queries{% elif b %}none of them{% else "
        "%}all of {{ n }}{% endif %}"
    )
    assert set(templated(text)) >= {"… of the queries", "none of them", "all of …"}


def test_only_the_first_column_of_tables_of_messages_is_read() -> None:
    page = (
        "| other |\n|---|\n| `no` |\n\n| message | why |\n|---|---|\n| `` a `b` ``<br>`c\\|d` | "
        "`no` |\n\n| x |\n| `no` |\n"
    )
    assert entries(page) == ["a `b`", "c|d"]
