"""Run all races and print them; with `--peers DIR` those against peers' own programs."""

import argparse
from pathlib import Path

from benchmarks import peers, pointcloud2, reading, waiting

parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
parser.add_argument(
    "--peers",
    type=Path,
    metavar="DIR",
    help="Race the peers' programs in this folder instead (benchmarks/PEERS.md)",
)
if (folder := parser.parse_args().peers) is not None:
    for line in peers.run(folder):
        print(line)
else:
    for races in (reading, pointcloud2, waiting):
        for result in races.run():
            print(result.table(), end="\n\n")
