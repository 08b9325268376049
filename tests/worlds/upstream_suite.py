"""Minigrid's and Miniworld's own tests on our worlds: copy a checkout's tests, put our ids into them, run them.

    python -m tests.worlds.upstream_suite ~/src/Minigrid -n2
    xvfb-run -a python -m tests.worlds.upstream_suite ~/src/Miniworld

What follows the checkout goes to pytest. What is replaced stands in `REPLACED`, and is printed. Minigrid's tests of its
bot stay on its own ids: the bot reads the instruction objects inside Minigrid's environments. Those of its scripts and
of its Wave Function Collapse do not make environments, or none of ours, and are not run. One of Miniworld's tests makes
an environment of its own class, which needs a display.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

OURS = "[spec for id, spec in gym.envs.registry.items() if id.startswith({})]"


class Replaced(NamedTuple):
    """A text of the tests and what stands there instead."""

    text: str
    instead: str


REPLACED = (
    Replaced('"MiniGrid-', '"minihuman/MiniGrid-'),
    Replaced('"MiniWorld-', '"minihuman/MiniWorld-'),
    Replaced('if "MiniWorld" in env_id', 'if env_id.startswith("minihuman/MiniWorld")'),
    Replaced(".env.env", ".unwrapped"),  # ours have no wrappers to take off
    Replaced(
        "from miniworld.miniworld import MiniWorldEnv",
        "from minihuman.worlds.first_person.env import FirstPersonEnv as MiniWorldEnv",
    ),
)
ADDED = {  # to the end of a file: the specs of all our grid worlds
    "utils.py": "all_testing_env_specs = "
    + OURS.format(("minihuman/MiniGrid-", "minihuman/BabyAI-"))
    + "\nminigrid_testing_env_specs = "
    + OURS.format(("minihuman/MiniGrid-",))
    + "\n",
    "conftest.py": "import minihuman\n",
}
AS_THEY_ARE = ("test_baby_ai_bot.py",)
NOT_RUN = ("test_scripts.py", "test_wfc")


def copy_tests(checkout: Path, into: Path) -> list[str]:
    """Copy a checkout's tests with our ids in them; what was replaced, a line each."""
    lines = []
    (into / "tests").mkdir()
    for file in sorted((checkout / "tests").glob("*.py")):
        if file.name in NOT_RUN:
            continue
        text = file.read_text()
        for old, new in () if file.name in AS_THEY_ARE else REPLACED:
            if old in text:
                lines.append(f"{file.name}: {text.count(old)} x {old} -> {new}")
                text = text.replace(old, new)
        (into / "tests" / file.name).write_text(text)
    for name, text in ADDED.items():
        file = into / "tests" / name
        if name == "conftest.py" or file.exists():
            file.write_text((file.read_text() if file.exists() else "") + "\n" + text)
    return lines


def main() -> int:
    """Run them; pytest's exit status."""
    checkout, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        print("\n".join(copy_tests(Path(checkout), Path(folder))), flush=True)
        pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests", *arguments]
        ours = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}  # the minihuman beside this file
        return subprocess.run(pytest, cwd=folder, env=ours, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
