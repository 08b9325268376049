"""Reward over a block's episodes, by group, with the 95 % interval of the mean."""

import sys
from pathlib import Path

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import read_selected_sessions
from minihuman.figures.figure_data import collect_learning_curves
from minihuman.figures.gallery import collect_rewards
from minihuman.figures.learning_curves import learning_figure
from minihuman.figures.style import save_figure


def main(study: str, block: str, out: str) -> None:
    logs, account = read_selected_sessions([Path(study)], Selection(block=(block,)))
    print(
        *save_figure(
            learning_figure(collect_learning_curves(collect_rewards(logs)), measure="reward", limits=(0, 1)), Path(out)
        ),
        sep="\n",
    )
    print(*account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
