"""Run `python -m minihuman`."""

from minihuman.cli import main

main()
