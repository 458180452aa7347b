"""`python -m pipeline.cli` is `yearloc`."""

from pipeline.cli import main

main()
