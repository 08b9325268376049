import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import minihuman

pytestmark = pytest.mark.program

PACKAGE = Path(minihuman.__file__).parent


def facts_of(folder: Path) -> str:
    """What a minihuman in that folder says of the machine, in a process of its own."""
    say = "import minihuman, minihuman.runtime.machine as m; print(minihuman.__file__, m.collect_machine_facts())"
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, "-P", "-c", say], env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_the_commit_told_is_minihumans_own_and_no_other_repositorys(tmp_path: Path) -> None:
    git = ["git", "-C", str(tmp_path), "-c", "user.name=n", "-c", "user.email=e"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "a lab's study"], check=True)
    shutil.copytree(PACKAGE, tmp_path / "env" / "minihuman", ignore=shutil.ignore_patterns("__pycache__"))
    inside_another = facts_of(tmp_path / "env")
    assert str(tmp_path) in inside_another
    assert "git_commit" not in inside_another
    (tmp_path / "env" / "minihuman").rename(tmp_path / "minihuman")
    assert "git_commit" in facts_of(tmp_path)
