"""A session's steps, times, outcomes and keys, episode by episode."""

import sys
from pathlib import Path

from minihuman.figures.files import save
from minihuman.figures.overview import overview_figure
from minihuman.log.read.open_log import open_log


def main(log: str, out: str) -> None:
    print(*save(overview_figure(open_log(Path(log))), Path(out)), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
