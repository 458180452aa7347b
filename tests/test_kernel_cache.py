"""Compiled kernels are kept where a folder can be written; a slow first start is reported."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from pipeline import kernel_cache
from pipeline.cli.kernels import tell_cold
from tests.online.made import packed, scan

FIRST_KERNEL = """
import os
real = os.access
os.access = lambda path, mode, **how: False
import numba.core.caching as caching
for locator in (caching.InTreeCacheLocator, caching.UserWideCacheLocator):
    locator.ensure_cache_path = lambda self: (_ for _ in ()).throw(OSError("read-only"))
import pipeline
from pipeline.formats.pointcloud2 import decode
print(pipeline.KERNELS)
"""
"""A program that defines a kernel where neither the source nor the home can be written."""


def run(folder: Path) -> str:
    """Run FIRST_KERNEL with this temporary folder; returns where kernels are kept."""
    environment = {
        name: value for name, value in os.environ.items() if name != kernel_cache.CACHE_VARIABLE
    } | {"TMPDIR": str(folder)}
    ended = subprocess.run(
        [sys.executable, "-c", FIRST_KERNEL],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not ended.stderr
    return ended.stdout.strip()


def test_without_a_home_kernels_are_kept_in_a_temporary_folder_of_this_user(tmp_path: Path) -> None:
    own = tmp_path / f"yearloc-kernels-{os.getuid()}"
    assert run(tmp_path) == str(own)
    assert own.stat().st_mode & 0o077 == 0
    own.chmod(0o777)  # others may have put something there, and it would be run
    assert run(tmp_path) == "nowhere"


def test_a_cold_start_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(tell_cold.__globals__, "cold", lambda kernel: True)
    tell_cold()
    assert "compiling kernels, once per machine: half a minute" in capsys.readouterr().err
    monkeypatch.setitem(tell_cold.__globals__, "cold", lambda kernel: False)
    tell_cold()
    assert not capsys.readouterr().err


def test_a_function_that_is_not_compiled_is_not_cold() -> None:
    """NUMBA_DISABLE_JIT leaves kernels as plain functions."""
    assert not kernel_cache.cold(lambda x: x)


def test_a_kernel_is_cold_until_numba_keeps_it_wherever_that_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    source = tmp_path / "kernel.py"
    source.write_text("from numba import njit\n@njit(cache=True)\ndef one(x): return x + 1\n")

    def kernel() -> Any:
        spec = importlib.util.spec_from_file_location("kernel", source)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.one

    assert kernel_cache.cold(kernel())
    assert kernel()(1) == 2
    (tmp_path / "beside.py").write_text("")  # newer than what is kept, and no kernel's source
    assert not kernel_cache.cold(kernel())
    source.write_text(source.read_text() + "# another source")
    os.utime(source, (0, 0))
    assert kernel_cache.cold(kernel())


def test_a_folder_that_can_be_written_is_left_to_numba(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(kernel_cache.CACHE_VARIABLE, str(tmp_path))
    assert kernel_cache.choose_folder() == ""
    assert os.environ[kernel_cache.CACHE_VARIABLE] == str(tmp_path)


@pytest.mark.slow
def test_what_is_compiled_beforehand_is_all_that_a_first_scan_takes(tmp_path: Path) -> None:
    site = packed(tmp_path)
    np.save(tmp_path / "scan.npy", scan()[0].astype(np.float32))
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}

    def run(*words: str) -> tuple[str, set[str]]:
        command = [sys.executable, "-m", "pipeline.cli", *words]
        ended = subprocess.run(
            command, env=os.environ | kept, capture_output=True, text=True, check=True
        )
        return ended.stdout, {str(path) for path in (tmp_path / "kernels").rglob("*.nbc")}

    reported, compiled = run("kernels")
    assert reported.startswith("compiled in ")
    assert compiled
    reported, after = run("localize", str(site), str(tmp_path / "scan.npy"))
    assert "accepted" in reported
    assert after == compiled
