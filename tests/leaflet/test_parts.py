"""What the page is put together from: markup, tables, pictures and typed arrays."""

import io
import json
from base64 import b64decode
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import ArtifactError
from pipeline.leaflet.atlas import COLUMNS, Atlas, shifts, spectra
from pipeline.leaflet.chart import packed
from pipeline.leaflet.markup import Html, anchor, data, inline, prose, tag
from pipeline.leaflet.plate import plate, url
from pipeline.leaflet.sortable import key, sortable
from pipeline.leaflet.sources import Lock, entry, place
from pipeline.reports.matches import likest_shift
from pipeline.reports.table import Table
from pipeline.views.scan_context import quantize
from tests.leaflet.made import EVIL, SVG, heights


def test_text_is_escaped_and_markup_is_not() -> None:
    assert tag("p", "1 < 2", tag("b", "&"), class_='"x"') == '<p class="&quot;x&quot;">1 &lt; 2<b>&amp;</b></p>'
    assert tag("img", alt="", src=None) == '<img alt="">'
    assert anchor("at", "artifacts/train/campus/10m/sci.safetensors") == "at-artifacts-train-campus-10m-sci-safetensors"


def test_data_ends_no_script_and_reads_back() -> None:
    told = data("d", {"words": EVIL})
    assert told.count("</script>") == 1
    assert json.loads(told.partition(">")[2].removesuffix("</script>")) == {"words": EVIL}


def test_the_little_markdown_of_the_words() -> None:
    assert inline("**a** *b* `c_*d*` <i>") == "<strong>a</strong> <em>b</em> <code>c_*d*</code> &lt;i&gt;"
    assert inline("within 5 m, 90 %") == "within 5\N{NO-BREAK SPACE}m, 90\N{NO-BREAK SPACE}%"
    assert prose("One.\n\n- two\n- three\n  more") == "<p>One.</p><ul><li>two</li><li>three\n  more</li></ul>"


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        *(("0.728 [.68, .77] −", "0.728"), ("−0.232 [−0.38, −0.12]", "-0.232"), ("+0.031", "0.031"), ("1,204", "1204")),
        *(("3.3 ± 0.3", "3.3"), ("–", ""), ("worse", ""), ("0.756 on 2012-02-04", "0.756")),
    ],
)
def test_numbers_are_sorted_by_what_they_begin_with(cell: str, expected: str) -> None:
    assert key(cell) == expected


def test_a_table_links_its_numbers_and_keeps_the_mean_below() -> None:
    table = Table(("day", "sci"), (("a<b", "0.5 [.4, .6] −"), ("mean", "–")), words=1)
    shown = sortable(table, "Of `sci`", lambda row, heading, column: f"{heading}-{column}")
    assert isinstance(shown, Html)
    assert '<tbody><tr><th scope="row" class="words"><a href="#day-0">a&lt;b</a></th>' in shown
    assert '<td data-key="0.5"><a href="#sci-1">' in shown
    assert "<small>[.4, .6]</small>" in shown
    assert '<b class="mark">−</b>' in shown
    assert '<tfoot><tr><th scope="row" class="words"><a href="#day-0">mean</a></th><td data-key="">–</td></tr></tfoot>' in shown


def test_a_figure_is_an_image_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "a.svg").write_text(SVG + "\n%é")
    shown = plate(tmp_path / "a.svg", "Title", "Read *so*.", "Says.")
    assert '"' not in url(SVG)
    assert "#" not in url(SVG)
    assert unquote(url("a\n%é").partition(",")[2]) == "a %é"
    assert "--wide: 115px" in shown  # 72 pt are 96 px, shown at 1.2 times that
    assert "<strong>Title.</strong> Read <em>so</em>. Says.</figcaption>" in shown
    with pytest.raises(ArtifactError, match=r"b\.svg: no such figure"):
        plate(tmp_path / "b.svg", "", "")


def test_an_atlas_holds_every_view_as_quantized() -> None:
    images = heights(COLUMNS + 3)
    image = Image.open(io.BytesIO(Atlas.of(images).png))
    assert (image.mode, image.size) == ("P", (COLUMNS * 120, 80))
    sheet = np.asarray(image)
    for n in (0, COLUMNS - 1, COLUMNS, COLUMNS + 2):
        row, column = divmod(n, COLUMNS)
        assert (sheet[40 * row : 40 * row + 40, 120 * column : 120 * column + 120] == quantize(images[n])).all()
    red, green, blue = image.getpalette()[:3]
    assert (red, green, blue) == (0, 0, 131)  # an empty bin (METHODS 2.1)


def test_views_are_rolled_to_where_they_look_most_alike() -> None:
    images = heights(4)
    turned = np.stack([np.roll(image, by, axis=1) for image, by in zip(images, (0, 7, 60, 119), strict=True)])
    assert shifts(spectra(turned), spectra(images), 120).tolist() == [0, 7, 60, 119]
    assert [likest_shift(one, other) for one, other in zip(turned, images, strict=True)] == [0, 7, 60, 119]


def test_typed_arrays_read_back() -> None:
    values = np.array([[1.5, -2.0], [np.nan, 3e4]])
    assert np.array_equal(np.frombuffer(b64decode(packed(values, "<f4")), "<f4"), values.ravel(), equal_nan=True)
    assert np.frombuffer(b64decode(packed(np.array([-1, 0, 24]), "<i2")), "<i2").tolist() == [-1, 0, 24]
    assert b64decode(packed(np.array([258]), "<u2")) == b"\x02\x01"


def test_the_lock_knows_an_artifact_by_the_folder_around_it(tmp_path: Path) -> None:
    (tmp_path / "dvc.lock").write_text(
        "stages:\n  train@a:\n    params: {conf/train.yaml: {seed: 1}}\n    outs: [{path: artifacts/train/a, md5: 0a.dir}]\n"
    )
    lock = Lock.read(tmp_path / "dvc.lock")
    assert lock.of("artifacts/train/a/b.zarr") == ("0a.dir", "train@a")
    assert lock.of("artifacts/train") == ("", "")
    assert "0a.dir" in entry("artifacts/train/a", lock)
    assert "not in dvc.lock" in entry("x", Lock.read(tmp_path / "none"))
    assert f'id="{place("x")}"' in entry("x", lock)
