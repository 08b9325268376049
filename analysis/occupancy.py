"""Where everybody was in one world, every participant weighing the same."""

import sys
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.data.study import readable
from minihuman.figures.files import save
from minihuman.figures.occupancy import occupancy_figure


def main(study: str, world: str, out: str) -> None:
    logs, account = readable([Path(study)], Selection())
    theirs = [[episode for episode in log.episodes if episode.plan.world == world] for log in logs]
    print(*save(occupancy_figure(world, [episodes for episodes in theirs if episodes]), Path(out)), sep="\n")
    print(*account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
