"""The trajectory figure: one participant's numbered episodes, a block beside the other."""

import sys
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.data.study import readable
from minihuman.figures.files import save
from minihuman.figures.paths import session_paths


def main(log: str, out: str) -> None:
    (session,), account = readable([Path(log)], Selection())
    print(*save(session_paths(session), Path(out)), *account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
