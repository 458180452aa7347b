"""The time and memory of a stage are stored as a trace, and sampling never disturbs the stage."""

import json
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from pipeline.running.telemetry import MOST_SAMPLES, Telemetry, Trace, costs, trace_path


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_trace_lies_beside_its_artifact_in_a_folder_of_its_own() -> None:
    assert trace_path("artifacts/train/sci.zarr.zip") == Path(
        ".telemetry/artifacts/train/sci.zarr.zip.json"
    )
    assert trace_path(Path("artifacts").absolute() / "views") == Path(
        ".telemetry/artifacts/views.json"
    )


def test_the_block_and_what_it_starts_are_measured() -> None:
    """A child uses 0.2 s of CPU time, so the trace has as much, whatever else runs here."""
    burn = "import time\nwhile time.process_time() < 0.2: pass"
    with Telemetry("artifacts/a", every_s=0.02):
        held = bytearray(50_000_000)
        subprocess.run([sys.executable, "-c", burn], check=True)
    del held
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert trace.cpu_s >= 0.2
    assert trace.wall_s >= 0.2
    assert trace.peak_memory_mb >= 50
    assert len(trace.seconds) == len(trace.cpu_percent) == len(trace.memory_mb) > 2
    assert sorted(trace.seconds) == list(trace.seconds)


def test_a_block_shorter_than_the_first_second_has_one_sample() -> None:
    with Telemetry("artifacts/a"):
        time.sleep(0.01)
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert len(trace.seconds) == 1


def test_a_long_run_keeps_few_samples_and_its_length() -> None:
    """Whenever there are too many samples, every other one is dropped and the pace halves."""
    telemetry = Telemetry("artifacts/a", every_s=0.0005)
    with telemetry:
        while telemetry.every_s == 0.0005:
            time.sleep(0.01)
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert MOST_SAMPLES / 2 - 1 <= len(trace.seconds) <= MOST_SAMPLES
    # A machine under load may come late to the last sample, but not by half of the run.
    assert trace.wall_s / 2 < trace.seconds[-1] < 2 * trace.wall_s


def test_a_block_that_fails_leaves_the_old_trace() -> None:
    with Telemetry("artifacts/a"):
        pass
    before = trace_path("artifacts/a").read_text()
    with pytest.raises(RuntimeError), Telemetry("artifacts/a"):
        raise RuntimeError
    assert trace_path("artifacts/a").read_text() == before


def test_a_trace_that_cannot_be_written_does_not_disturb_the_block(project: Path) -> None:
    (project / ".telemetry").write_text("in the way")
    with Telemetry("artifacts/a"):
        done = True
    assert done
    with Telemetry("/elsewhere/a"):
        pass
    assert not Path("/elsewhere").exists()


def test_a_missing_trace_and_one_of_another_version_are_none() -> None:
    assert Trace.read("artifacts/a") is None
    assert Trace.read("/elsewhere/a") is None
    trace_path("artifacts/a").parent.mkdir(parents=True)
    trace_path("artifacts/a").write_text(json.dumps({"other": 1}))
    assert Trace.read("artifacts/a") is None


def test_memory_of_a_gpu_is_watched_if_torch_uses_one(monkeypatch: pytest.MonkeyPatch) -> None:
    cuda = SimpleNamespace(is_initialized=lambda: True, memory_reserved=lambda: 3_000_000_000)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=cuda))
    with Telemetry("artifacts/a"):
        pass
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert trace.gpu_memory_mb == [3000.0]


def test_of_the_samples_of_one_second_the_last_is_logged() -> None:
    trace = Trace(
        3.2, 4.0, 90.0, [0.9, 2.1, 3.2, 3.3], [100.0, 150.0, 50.0, 10.0], [80.0, 90.0, 85.0, 86.0]
    )
    assert trace.series() == {
        "system/process_cpu_percentage": [(1, 100.0), (2, 150.0), (3, 10.0)],
        "system/process_memory_megabytes": [(1, 80.0), (2, 90.0), (3, 86.0)],
    }


def test_a_stage_costs_what_its_artifacts_cost_together() -> None:
    Trace(10.0, 15.0, 500.0).write("train/sci")
    Trace(1.0, 1.5, 300.0).write("localize/june")
    Trace(2.0, 2.5, 200.0).write("localize/july")
    Trace(9.0, 9.0, 900.0).write("evaluate/june")
    found = costs(
        {
            "train": [Path("train/sci")],
            "localize": [Path("localize/june"), Path("localize/july")],
            # a trace is missing, so the sum is unknown
            "evaluate": [Path("evaluate/june"), Path("evaluate/july")],
            "views": [],
        }
    )
    assert found == {
        "train_wall_s": 10.0,
        "train_cpu_s": 15.0,
        "train_peak_memory_mb": 500.0,
        "localize_wall_s": 3.0,
        "localize_cpu_s": 4.0,
        "localize_peak_memory_mb": 300.0,
    }
