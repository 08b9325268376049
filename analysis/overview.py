"""A session's steps, times, outcomes and keys, episode by episode."""

import sys
from pathlib import Path

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import read_selected_sessions
from minihuman.figures.overview import overview_figure
from minihuman.figures.style import save_figure


def main(log: str, out: str) -> None:
    (session,), account = read_selected_sessions([Path(log)], Selection())
    print(*save_figure(overview_figure(session), Path(out)), *account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
