"""Run every race and print it."""

from benchmarks import pointcloud2, reading, scan_context

for races in (scan_context, reading, pointcloud2):
    for result in races.run():
        print(result.table(), end="\n\n")
