"""Mean and standard deviation of reward by subject and group, in the block that the groups share, as CSV."""

import sys
from pathlib import Path

import pandas as pd

from minihuman.report.results import results
from minihuman.report.study import Reading, Session, read_study


def main(study: str, out: str) -> None:
    rows = [one.rows for one in read_study(Path(study), Reading()) if isinstance(one, Session)]
    names = ("episodes", "blocks", "participants")
    found = results(*(pd.concat([one[name].to_pandas() for one in rows]) for name in names))
    found.subjects.to_csv(out, index=False)
    print(found.groups.to_string(index=False))


if __name__ == "__main__":
    main(*sys.argv[1:])
