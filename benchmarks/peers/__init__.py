"""Races of peers' own programs with ours: `python -m benchmarks --peers DIR`.

Nothing is built here: DIR holds the programs that benchmarks/PEERS.md says how to build, and a
program that is not there is left out. Each runs in a process of its own, since in one process a
peer would pay for the memory that another left behind. All measure CPU time of one thread and print
a median in milliseconds, and the megabytes of a map if they build one.
"""

import os
import statistics
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.peers import given

ROUNDS = 5
OURS = sys.executable, "-m", "benchmarks.peers"
Commands = Mapping[str, Sequence[str | Path]]


def run(folder: Path) -> Iterator[str]:
    """The table of each race."""
    with TemporaryDirectory() as scratch:
        yield from drawing(folder, Path(scratch))
        yield from signing(folder, Path(scratch))
        yield from searching(folder, Path(scratch))
        yield from following(folder, Path(scratch))
        yield from answering(folder, Path(scratch))
        yield from mapping(folder, Path(scratch))


def drawing(folder: Path, scratch: Path) -> Iterator[str]:
    """Scan Context, 40 × 120 bins within 80 m, of whole scans without a voxel filter."""
    name, scans = given.clouds(scratch / "points")
    words = scratch / "points", str(scans)
    yield table(
        f"Scan Context of {name}",
        {
            "yearloc": (*OURS, "draw", *words, scratch / "ours"),
            "its authors' C++, -O3": (folder / "scan_context", "draw", *words, scratch / "theirs"),
            "its authors' C++, -O3 -march=native": (
                folder / "scan_context_native",
                "draw",
                *words,
                scratch / "native",
            ),
        },
    )
    if (scratch / "theirs").exists():
        ours = np.fromfile(scratch / "ours", "<f4").reshape(scans, 40, 120)
        theirs = np.fromfile(scratch / "theirs", "<f4").reshape(scans, 120, 40).transpose(0, 2, 1)
        same = np.isclose(
            ours[:, :-1], theirs[:, :-1], atol=1e-6
        )  # what lies beyond the last ring they drop
        yield (
            f"  {same.mean():.2%} of the bins equal; a border belongs to the outer bin here, to "
            "the inner one there"
        )


def signing(folder: Path, scratch: Path) -> Iterator[str]:
    """M2DP of whole scans."""
    name, scans = given.clouds(scratch / "points")
    words = scratch / "points", str(scans)
    yield table(
        f"M2DP of {name}",
        {
            "yearloc": (*OURS, "m2dp", *words, scratch / "ours"),
            "its authors' Matlab and C, in Octave": (folder / "m2dp", *words, scratch / "theirs"),
        },
    )
    if (scratch / "theirs").exists():
        ours, theirs = (
            np.abs(np.fromfile(scratch / each, "<f4").reshape(scans, 192))
            for each in ("ours", "theirs")
        )
        apart = np.abs(ours - theirs).max(axis=1)
        yield (
            f"  {(apart < 1e-4).sum()} of {scans} signatures equal to 1e-4, all to "
            f"{apart.max():.0e}"
        )


def searching(folder: Path, scratch: Path) -> Iterator[str]:
    """The nearest of 5,000 Scan Contexts."""
    rows, queries = given.images(scratch / "images")
    words = scratch / "images", str(rows), str(queries)
    yield table(
        f"Nearest of {rows:,} Scan Contexts",
        {
            "yearloc, 50 by ring key, all shifts": (
                *OURS,
                "search",
                *words,
                scratch / "ours50",
                "50",
            ),
            "yearloc, all of them, all shifts": (*OURS, "search", *words, scratch / "ours", "0"),
            "its authors' C++, 50, all shifts": (
                folder / "scan_context_50",
                "search",
                *words,
                scratch / "theirs50",
            ),
            "its authors' C++, 50, a tenth of the shifts": (
                folder / "scan_context_50_fast",
                "search",
                *words,
                scratch / "fast50",
            ),
            "its authors' C++, 10, a tenth of the shifts": (
                folder / "scan_context",
                "search",
                *words,
                scratch / "theirs",
            ),
        },
    )
    labels = {
        "ours50": "our 50",
        "theirs50": "their 50",
        "fast50": "their 50 at a tenth of the shifts",
        "theirs": "their 10",
    }
    true_nearest = np.fromfile(scratch / "ours", "<f4").reshape(queries, 2)[:, 0]
    found = [(name, scratch / name) for name in labels if (scratch / name).exists()]
    right = {
        name: int((np.fromfile(path, "<f4").reshape(queries, 2)[:, 0] == true_nearest).sum())
        for name, path in found
    }
    yield "  the nearest of all is found " + ", ".join(
        f"{n} times of {queries} by {labels[name]}" for name, n in right.items()
    )


def following(folder: Path, scratch: Path) -> Iterator[str]:
    """SeqSLAM: from the pixels of two drives to the match of each image."""
    rows = str(given.pictures(scratch / "pictures"))
    words = scratch / "pictures", rows
    yield table(
        f"SeqSLAM, {rows} × {rows} images",
        {
            "yearloc": (*OURS, "seqslam", *words, scratch / "ours_rows"),
            "pySeqSLAM": (folder / "seqslam", *words, scratch / "their_rows"),
        },
    )
    if (scratch / "their_rows").exists():
        same = np.fromfile(scratch / "ours_rows", "<i4") == np.fromfile(
            scratch / "their_rows", "<i4"
        )
        yield f"  {same.mean():.1%} of the matches equal"


def answering(folder: Path, scratch: Path) -> Iterator[str]:
    """SCI's network, a view at a time."""
    given.images(scratch / "images")
    network = scratch / "sci.onnx"
    few = str(given.QUERIES)
    np.fromfile(scratch / "images", "<f4", given.QUERIES * 40 * 120).tofile(scratch / "few")
    subprocess.run([*OURS, "export", network], stdout=subprocess.DEVNULL, check=True)
    words = network, scratch / "few", few
    yield table(
        f"SCI's network, {given.PLACES} places, a view at a time",
        {
            "yearloc, torch": (*OURS, "answer", *words, scratch / "torch", "torch"),
            "yearloc, a site that was exported": (
                *OURS,
                "answer",
                *words,
                scratch / "onnx",
                "onnxruntime",
            ),
            "OpenVINO": (folder / "openvino", *words, scratch / "openvino"),
        },
    )
    found = [scratch / each for each in ("torch", "onnx", "openvino") if (scratch / each).exists()]
    first, *others = (np.fromfile(path, "<f4").reshape(given.QUERIES, -1) for path in found)
    yield "  scores differ by " + ", ".join(
        f"{np.abs(other - first).max():.1g}" for other in others
    )


def mapping(folder: Path, scratch: Path) -> Iterator[str]:
    """Scans into an occupancy map, one ray a cell, without decay.

    All programs cut rays at the same range; our rays also end at the octree's cube.
    """
    name, scans = given.drive(scratch / "points", scratch / "origins")
    for leaf_m, depth, range_m in ((50 / 128, 7, 25.0), (0.2, 9, 30.0), (0.2, 9, 51.2)):
        words = scratch / "points", str(scans), scratch / "origins", str(leaf_m), str(range_m)
        yield table(
            f"Octree of {leaf_m:.2f} m, ±{leaf_m * 2**depth / 2:.1f} m, rays of {range_m} m, "
            f"{name}",
            {
                "yearloc": (*OURS, "octree", *words, str(depth)),
                "Bonxai's C++, -O3": (folder / "bonxai", *words),
            },
        )


def table(name: str, commands: Commands) -> str:
    """Medians over rounds in turn of the programs that are there, and ratios to the first."""
    there = {each: words for each, words in commands.items() if Path(words[0]).exists()}
    took: dict[str, list[tuple[float, ...]]] = {each: [] for each in there}
    load = os.getloadavg()[0]
    for _ in range(ROUNDS):
        for each, words in there.items():
            done = subprocess.run(
                [str(word) for word in words],
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                check=True,
            )
            took[each].append(tuple(float(word) for word in done.stdout.split()))
    lines = [f"{name} (medians of {ROUNDS} processes, load {load:.1f})"]
    first = statistics.median(one[0] for one in next(iter(took.values())))
    for each, rounds in took.items():
        times = [one[0] for one in rounds]
        median = statistics.median(times)
        memory = f", {rounds[-1][1]:.1f} MB" if len(rounds[-1]) > 1 else ""
        lines.append(
            f"  {each:<46}{median:9.3f} ms {median / first:8.2f} ×   "
            f"{min(times):.3f}…{max(times):.3f}{memory}"
        )
    missing = [str(Path(words[0]).name) for each, words in commands.items() if each not in there]
    return "\n".join(lines + ([f"  not there: {', '.join(missing)}"] if missing else []))
