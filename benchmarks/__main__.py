"""Run every race and print it."""

from benchmarks import encoding, m2dp, octree, pointcloud2, pointnetvlad, reading, retrieval, scan_context, sequence, waiting

for races in (scan_context, retrieval, m2dp, pointnetvlad, encoding, sequence, octree, reading, pointcloud2, waiting):
    for result in races.run():
        print(result.table(), end="\n\n")
