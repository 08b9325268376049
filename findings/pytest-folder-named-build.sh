#!/usr/bin/env bash
# pytest 8.4.2 and 9.0.2 (Python 3.11 on Linux): the tests of a package's build steps lie in `tests/build/test_steps.py`.
# A run of `pytest` or `pytest tests` passes over that folder without a word, also with --strict-config and -ra, and ends
# well if anything else was collected: "build" and "dist" are among the default patterns of `norecursedirs`, beside
# ".*" and "node_modules". Named by itself, the folder is collected, so that whoever works in it sees its tests run.
# Seen when this was written:
#   8.4.2: pytest: tests/other/test_steps.py
#   8.4.2: pytest tests: tests/other/test_steps.py
#   8.4.2: pytest tests/build: tests/build/test_steps.py
#   8.4.2: pytest -o norecursedirs=.*: tests/build/test_steps.py tests/other/test_steps.py
#   9.0.2: pytest: tests/other/test_steps.py
#   9.0.2: pytest tests: tests/other/test_steps.py
#   9.0.2: pytest tests/build: tests/build/test_steps.py
#   9.0.2: pytest -o norecursedirs=.*: tests/build/test_steps.py tests/other/test_steps.py
# Exits 1 if that has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/project/tests/build" "$work/project/tests/other"
for folder in build other; do
  touch "$work/project/tests/$folder/__init__.py"
  echo "def test_it(): pass" >"$work/project/tests/$folder/test_steps.py"
done
for version in 8.4.2 9.0.2; do
  python3 -m pip install -q --target "$work/$version" "pytest==$version"
done
set -f # ".*" is a pattern for pytest, not for the shell
for version in 8.4.2 9.0.2; do
  for arguments in "" "tests" "tests/build" "-o norecursedirs=.*"; do
    # shellcheck disable=SC2086
    collected=$(cd "$work/project" && PYTHONPATH="$work/$version" python3 -m pytest --collect-only -q --strict-config $arguments |
      sed -n 's/::test_it$//p' | sort | paste -sd " ")
    echo "$version: pytest${arguments:+ $arguments}: $collected"
  done
done | tee "$work/seen"
diff <(sed -n 's/^#   //p' "$0") "$work/seen"
