"""The tutorial's way from one's own bags to a localiser, command by command."""

import re
from pathlib import Path

import pytest
import yaml

from pipeline.core.compute import Compute
from pipeline.core.progress import Progress
from tests.clone import ROOT, Clone
from worlds.simulation import Simulation

FEW = ["methods=scan_context", "variants=", "perturbed=", "latency=no"]
DAYS = {"2012-01-15": "monday", "2012-06-15": "tuesday"}


def commands(heading: str) -> list[list[str]]:
    """The words of each command in the first block under a heading of the tutorial."""
    text = (ROOT / "docs/tutorials/own-data.md").read_text()
    block = re.search(rf"## {heading}\n.*?```\n(.*?)```", text, re.DOTALL)
    assert block
    return [words for line in block[1].splitlines() if (words := line.partition("#")[0].split())]


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    """The project, and in it a robot's bags: a folder a day."""
    clone = Clone(tmp_path)
    clone.draw_small()
    settings = yaml.safe_load((ROOT / "conf/world/campus_tiny.yaml").read_text()) | {"logs": "mcap"}
    settings.pop("_target_")
    for date, day in DAYS.items():
        Simulation(**settings).record(date, clone.folder / "bags" / day, Compute(), Progress())
    return clone


def test_five_commands_lead_from_bags_to_a_localiser(clone: Clone) -> None:
    steps = commands("From ROS bags, in five commands")
    assert len(steps) == 5
    for step in steps:
        few = FEW if step[:2] == ["yearloc", "use"] else []
        words = [
            word.replace("=demo", "=tiny").replace("sci_ring", "scan_context") for word in step
        ]
        said = clone.run(*words, *few)
    assert "ScanContext50" in said  # the last one looks at the localiser
    assert (clone.folder / "artifacts/train/robot/10m/scan_context.zarr.zip").is_file()
