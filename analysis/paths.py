"""The trajectory figure: one participant's numbered episodes, a block beside the other."""

import sys
from pathlib import Path

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import read_selected_sessions
from minihuman.figures.path_figures import session_paths
from minihuman.figures.style import save_figure


def main(log: str, out: str) -> None:
    (session,), account = read_selected_sessions([Path(log)], Selection())
    print(*save_figure(session_paths(session), Path(out)), *account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
