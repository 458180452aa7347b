"""Run every race and print it."""

from benchmarks import m2dp, pointcloud2, pointnetvlad, reading, retrieval, scan_context

for races in (scan_context, retrieval, m2dp, pointnetvlad, reading, pointcloud2):
    for result in races.run():
        print(result.table(), end="\n\n")
