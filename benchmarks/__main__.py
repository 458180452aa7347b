"""Run every race and print it."""

from benchmarks import scan_context

for result in scan_context.run():
    print(result.table(), end="\n\n")
