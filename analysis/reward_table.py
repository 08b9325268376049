"""Mean and standard deviation of reward by subject and group, in the block that the groups share, as CSV."""

import sys
from pathlib import Path

import pandas as pd

from minihuman.dataset.sessions import StudySessions
from minihuman.reporting.results import compute_results


def main(study: str, out: str) -> None:
    sessions = StudySessions(Path(study))
    rows = [one.rows for one in sessions.rows(with_shortest=True)]
    names = ("episodes", "blocks", "participants")
    found = compute_results(*(pd.concat([one[name].to_pandas() for one in rows]) for name in names))
    target = found.target_block
    if target is None:
        raise SystemExit("no block was played by every group")
    target.subjects.to_csv(out, index=False)
    print(target.groups.to_string(index=False))
    print(*sessions.account.lines(), sep="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
