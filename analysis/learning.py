"""Reward over a block's episodes, by group, with the 95 % interval of the mean."""

import sys
from pathlib import Path

from minihuman.data.opened import Skipped, opened
from minihuman.figures.files import save
from minihuman.figures.gallery import learning_curves
from minihuman.figures.learning import learning_figure


def main(study: str, block: str, out: str) -> None:
    logs = [log for log in opened(Path(study)) if not isinstance(log, Skipped)]
    print(*save(learning_figure(learning_curves(logs)[block], measure="reward", limits=(0, 1)), Path(out)), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
