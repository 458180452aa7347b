"""The catalogue says what each method is, for `yearloc methods`, the front pages and the report."""

from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError
from pipeline.studies import catalogue
from pipeline.studies.catalogue import Entry, entries, table

ROOT = Path(__file__).parents[2]


def test_every_method_with_a_yaml_is_listed_once() -> None:
    methods = entries()
    assert [method.name for method in methods] == sorted(
        path.stem for path in (ROOT / "conf/method").glob("*.yaml")
    )
    for method in methods:
        assert method.description
        assert "METHODS" not in method.description + method.source
    sci = next(method for method in methods if method.name == "sci")
    what = "SCI localisation: places as classes of a small CNN over Scan Context Images"
    assert sci == Entry("sci", what, "scan_context_authors", "Kim, Park and Kim, RA-L 2019")
    assert catalogue.description_of("pipeline.methods.sci.Sci") == what
    assert (
        catalogue.description_of("pipeline.methods.none.Such") == catalogue.description_of("") == ""
    )


def test_a_table_for_the_front_pages() -> None:
    assert table(
        [Entry("a", "does this", "cloud", "ICRA 1999"), Entry("b", "does that", "m2dp", "")]
    ) == (
        "| method | what it is | looks at | source |\n"
        "| :-- | :-- | :-- | :-- |\n"
        "| `a` | does this | `cloud` | ICRA 1999 |\n"
        "| `b` | does that | `m2dp` | – |\n"
    )


def test_the_front_pages_hold_what_yearloc_methods_prints() -> None:
    block = f"<!-- methods -->\n{table(entries())}<!-- /methods -->"
    index = (ROOT / "docs/index.md").read_text()
    readme = (ROOT / "README.md").read_text()
    assert block in index
    assert block in readme or "<!-- methods -->" not in readme


def test_brackets_are_the_source_wherever_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue, "PROJECT", tmp_path)
    (tmp_path / "conf/method").mkdir(parents=True)
    (tmp_path / "conf/method/one.yaml").write_text("_target_: own.one.One\nview: cloud\n")
    (tmp_path / "own").mkdir()
    module = tmp_path / "own/one.py"
    module.write_text(
        '"""One: it looks (IROS 2016; METHODS 3.1),\nthen answers.\n\nMore (of this).\n"""\n'
    )
    assert entries(tmp_path / "conf") == [
        Entry("one", "One: it looks, then answers", "cloud", "IROS 2016")
    ]
    module.write_text("x = 1\n")
    with pytest.raises(ConfigError, match="first paragraph"):
        entries(tmp_path / "conf")
    module.unlink()
    with pytest.raises(ConfigError, match=r"own.one.One: no .*one\.py"):
        entries(tmp_path / "conf")
