#!/usr/bin/env bash
# pyarrow 16.1.0, 21.0.0 and 25.0.0 (Python 3.11 on Linux): a Parquet file with a text column `study` lies in a folder
# `study=grid`. `pyarrow.parquet.read_table` takes the folder's name for a second, dictionary-encoded column of that name
# and refuses to merge the two. Of the folder it does so in all three releases; of the file alone it depends on the
# release: 16.1.0 and 25.0.0 read it, and 21.0.0 (as 17 to 24, tried with 17.0.0, 18.0.0, 23.0.1, 24.0.0) does not.
# `pyarrow.dataset.dataset(folder, partitioning="hive")`, which promises the same, reads the folder in all of them.
# Seen when this was written:
#   16.1.0: file read, folder refused, folder as a dataset read, folder without partitioning read
#   21.0.0: file refused, folder refused, folder as a dataset read, folder without partitioning read
#   25.0.0: file read, folder refused, folder as a dataset read, folder without partitioning read
# Exits 1 if that has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/show.py" <<'PY'
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet

folder = Path(sys.argv[1])
file = folder / "study=grid" / "steps.parquet"
file.parent.mkdir(parents=True)
pa.parquet.write_table(pa.table({"study": ["grid"], "step": [1]}), file)


def tell(read):
    try:
        return "read" if read().column("study").to_pylist() == ["grid"] else "changed"
    except pa.ArrowTypeError:
        return "refused"


print(
    f"{pa.__version__}: file {tell(lambda: pa.parquet.read_table(file))}, "
    f"folder {tell(lambda: pa.parquet.read_table(folder))}, "
    f"folder as a dataset {tell(lambda: pa.dataset.dataset(folder, partitioning='hive').to_table())}, "
    f"folder without partitioning {tell(lambda: pa.parquet.read_table(folder, partitioning=None))}"
)
PY
for version in 16.1.0 21.0.0 25.0.0; do
  python3 -m pip install -q --target "$work/$version" "pyarrow==$version" "numpy<2"
  PYTHONPATH="$work/$version" python3 "$work/show.py" "$work/tables-$version"
done | tee "$work/seen"
diff <(sed -n 's/^#   //p' "$0") "$work/seen"
