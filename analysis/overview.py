"""A session's steps, times, outcomes and keys, episode by episode."""

import sys
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.data.study import readable
from minihuman.figures.files import save
from minihuman.figures.overview import overview_figure


def main(log: str, out: str) -> None:
    (session,), account = readable([Path(log)], Selection())
    print(*save(overview_figure(session), Path(out)), *account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
