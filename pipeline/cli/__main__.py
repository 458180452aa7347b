"""Lets `python -m pipeline.cli` run the command `yearloc`."""

from pipeline.cli import main

main()
