#!/usr/bin/env bash
# Numba 0.68.1 (llvmlite 0.50.0, NumPy 2.3.5, Python 3.11 on Linux): the LLVM module of a function that could raise an
# error of Numba's own array code (here `reshape`) holds the absolute path of the file of Numba that would raise it, in a
# pickled constant. So what is compiled ahead of time and shipped names a folder of whoever built it, and the same sources
# give other bytes in another folder, although every version is the same and the hash seed is fixed.
# Seen when this was written:
#   the module names Numba's folder: yes
#   the same function in another folder: another module
#   outside of these constants: the same instructions
# Exits 1 if that has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/show.py" <<'PY'
import sys

import numba
import numpy as np


@numba.njit
def fold(values):
    return values.reshape((2, values.size // 2))


fold(np.arange(4.0))
library = fold.overloads[fold.signatures[0]].library
print(library.get_llvm_str())
PY
for folder in one another-folder; do
  python3 -m pip install -q --target "$work/$folder" numba==0.68.1 llvmlite==0.50.0 numpy==2.3.5
  PYTHONHASHSEED=0 PYTHONPATH="$work/$folder" python3 "$work/show.py" >"$work/$folder.ll"
done
failed=0
if grep -q "$work/one/numba" "$work/one.ll"; then
  echo "the module names Numba's folder: yes"
else
  echo "the module names Numba's folder: no"
  failed=1
fi
if cmp -s "$work/one.ll" "$work/another-folder.ll"; then
  echo "the same function in another folder: the same module"
  failed=1
else
  echo "the same function in another folder: another module"
fi
# errors' pickles, their digests, and what refers to them are all that may differ
if diff <(grep -v '^@' "$work/one.ll" | grep -v 'picklebuf') <(grep -v '^@' "$work/another-folder.ll" | grep -v 'picklebuf') >/dev/null; then
  echo "outside of these constants: the same instructions"
else
  echo "outside of these constants: other instructions"
  failed=1
fi
exit "$failed"
