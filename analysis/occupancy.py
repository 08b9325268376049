"""Where everybody was in one world, every participant weighing the same."""

import sys
from pathlib import Path

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import read_selected_sessions
from minihuman.figures.occupancy import group_participants_by_group, occupancy_figure
from minihuman.figures.style import save_figure


def main(study: str, world: str, out: str) -> None:
    logs, account = read_selected_sessions([Path(study)], Selection())
    print(*save_figure(occupancy_figure(world, group_participants_by_group(logs, world)), Path(out)), sep="\n")
    print(*account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
