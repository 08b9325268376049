"""The trajectory figure: one participant's numbered episodes, a block beside the other."""

import sys
from pathlib import Path

from minihuman.figures.files import save
from minihuman.figures.paths import session_paths
from minihuman.log.read.open_log import open_log


def main(log: str, out: str) -> None:
    print(*save(session_paths(open_log(Path(log))), Path(out)), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
