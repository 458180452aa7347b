"""An exported network answers as torch's does, and a site on one thread needs no torch."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.building import target_of
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.matching.ranking import Rows
from pipeline.methods.sci import Sci
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks.classifier import Classifier
from pipeline.online import site_file
from pipeline.online.export import Parity, export
from pipeline.online.site import Site
from pipeline.views.scan_context import ScanContext
from tests.online.made import ANCHORS, arrays, described, scan
from tests.posing.scene import scene
from tests.readers.damage import one_line

SETTINGS = {"epochs": 3, "batch": 8, "threads": 1, "dropout": 0.1}
WITHOUT_TORCH = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError("torch", name="torch")
sys.meta_path.insert(0, Missing())
import numpy as np
from pipeline.online.site import Site
fix = Site.open(sys.argv[1]).localize(np.load(sys.argv[2]))
print(fix.verdict, *fix.world_T_sensor[:2, 3])
"""


@pytest.fixture(scope="module", params=[Sci, SciRing], ids=["sci", "sci_ring"])
def learned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A site whose method is a trained network."""
    method: Classifier = request.param(**SETTINGS)
    images = np.stack([ScanContext()(scene(seed)) for seed in range(3)] * 4)
    views = Rows(images, np.arange(12), np.tile(ANCHORS, (4, 1, 1)))
    model = method.learn(views, np.tile(np.arange(3), 4), Progress())
    target = target_of(method)
    path = tmp_path_factory.mktemp("learned") / "three.site"
    description = described(method={"_target_": target, **SETTINGS})
    site_file.write(path, site_file.Parts(description, model, arrays()[1], None))
    return path


def assert_answers_without_torch(site: Path, folder: Path) -> None:
    """Check that a site localises a scan in a process that has no torch."""
    points_m, world_T_robot = scan(2)
    np.save(folder / "scan.npy", points_m)
    words = [sys.executable, "-c", WITHOUT_TORCH, str(site), str(folder / "scan.npy")]
    verdict, x, y = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert verdict == "accepted"
    np.testing.assert_allclose([float(x), float(y)], world_T_robot[:2, 3], atol=0.1)


def test_a_site_answers_without_torch(learned: Path, tmp_path: Path) -> None:
    points_m, _ = scan(2)
    said = export(learned, tmp_path / "onnx.site")
    assert "off torch at most, 100% with the same best place" in said
    assert_answers_without_torch(tmp_path / "onnx.site", tmp_path)
    ours, theirs = (Site.open(path).rank(points_m) for path in (learned, tmp_path / "onnx.site"))
    np.testing.assert_array_equal(ours.places, theirs.places)
    np.testing.assert_allclose(ours.xy_m, theirs.xy_m)
    with one_line(ConfigError, "is exported already"):
        export(tmp_path / "onnx.site", tmp_path / "again.onnx")


def test_a_compact_site_is_a_third_as_large_and_gives_the_same_answers(
    learned: Path, tmp_path: Path
) -> None:
    points_m, _ = scan(2)
    whole, compact = (tmp_path / f"{name}.site" for name in ("whole", "compact"))
    export(learned, whole)
    assert "off torch at most" in export(learned, compact, compact=True)
    networks = [site_file.read(path).network or b"" for path in (whole, compact)]
    assert len(networks[1]) < len(networks[0]) / 3
    assert not any(str(Path.cwd()).encode() in network for network in networks)
    of_whole, of_compact = (Site.open(path).rank(points_m) for path in (whole, compact))
    assert of_whole.places[0, 0] == of_compact.places[0, 0]
    np.testing.assert_allclose(of_whole.costs, of_compact.costs, atol=0.1)


def test_a_packed_site_answers_on_one_thread_without_torch_as_with_it(
    learned: Path, tmp_path: Path
) -> None:
    points_m, _ = scan(2)
    assert_answers_without_torch(learned, tmp_path)
    plain, torchs = (Site.open(learned, threads).rank(points_m) for threads in (1, 2))
    np.testing.assert_array_equal(plain.places, torchs.places)
    np.testing.assert_allclose(plain.xy_m, torchs.xy_m)


def test_a_site_that_needs_torch_says_so(learned: Path) -> None:
    program = WITHOUT_TORCH.replace("Site.open(sys.argv[1])", "Site.open(sys.argv[1], threads=2)")
    words = [sys.executable, "-c", program, str(learned), "none"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    last_line = ended.stderr.splitlines()[-1]
    assert last_line.startswith("pipeline.core.errors.NotInstalledError")
    assert "torch: not installed" in last_line
    assert "pip install 'yearloc[site]'" in last_line


def test_the_comparison_with_torch_is_written_beside_the_file(
    learned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = b"network", Parity(32, 2e-5, 1.0)
    monkeypatch.setattr("pipeline.online.export.exported", lambda method, model, compact: found)
    assert "on 32 views 2.0e-05 off torch at most" in export(learned, tmp_path / "model.onnx")
    assert (tmp_path / "model.onnx").read_bytes() == b"network"
    beside = json.loads((tmp_path / "model.parity.json").read_text())
    assert beside == {
        "site": "three/10m/scan_context",
        "views": 32,
        "largest_difference": 2e-5,
        "same_first": 1.0,
    }
    found = b"network", Parity(32, 2e-3, 1.0)
    with one_line(ConfigError, "nothing was written"):
        export(learned, tmp_path / "other.onnx")
    assert not (tmp_path / "other.onnx").exists()


def test_what_cannot_be_exported_is_refused(three_places: Path, tmp_path: Path) -> None:
    with one_line(ConfigError, "ScanContext50: has no network to export"):
        export(three_places, tmp_path / "a.onnx")
    with one_line(ConfigError, "expected FILE.onnx or FILE.site"):
        export(three_places, tmp_path / "a.pth")
