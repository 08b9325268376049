"""Where everybody was in one world, every participant weighing the same."""

import sys
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.data.study import readable
from minihuman.figures.files import save
from minihuman.figures.occupancy import by_participant, occupancy_figure


def main(study: str, world: str, out: str) -> None:
    logs, account = readable([Path(study)], Selection())
    print(*save(occupancy_figure(world, by_participant(logs, world)), Path(out)), sep="\n")
    print(*account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
