"""Mean and standard deviation of reward by subject and group, in the block that the groups share, as CSV."""

import sys
from pathlib import Path

import pandas as pd

from minihuman.data.study import Reading, Session, read_study
from minihuman.report.results import results


def main(study: str, out: str) -> None:
    rows = [one.rows for one in read_study(Path(study), Reading()) if isinstance(one, Session)]
    names = ("episodes", "blocks", "participants")
    found = results(*(pd.concat([one[name].to_pandas() for one in rows]) for name in names))
    found.subjects.to_csv(out, index=False)
    print(found.groups.to_string(index=False))


if __name__ == "__main__":
    main(*sys.argv[1:])
