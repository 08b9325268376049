"""Reward over a block's episodes, by group, with the 95 % interval of the mean."""

import sys
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.data.study import readable
from minihuman.figures.drawn_from import learning_curves
from minihuman.figures.files import save
from minihuman.figures.gallery import rewards
from minihuman.figures.learning import learning_figure


def main(study: str, block: str, out: str) -> None:
    logs, account = readable([Path(study)], Selection(block=(block,)))
    print(*save(learning_figure(learning_curves(rewards(logs)), measure="reward", limits=(0, 1)), Path(out)), sep="\n")
    print(*account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
