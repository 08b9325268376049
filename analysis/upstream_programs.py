"""Run programs that were written for Minigrid on our worlds, unchanged but for the id, and compare what they print.

    python analysis/upstream_programs.py [--source https://github.com/{owner}/{name}] [--only NAME ...]

Fetches rl-starter-files, CleanRL and Minigrid's docs and tests at the commits below into a temporary folder with Git,
runs each program there on Minigrid's world and on ours, and compares: the figures of every update, the weights, the
printed lines, the bot's actions. Speeds and times are left out. ``--source`` may be a folder with bare repositories.
Writes ``upstream_programs.json`` and the page ``upstream_programs.md``. Needs minigrid, torch, stable-baselines3,
torch-ac, tensorboardX and, for CleanRL's, tensorboard, memory-gym, tyro and einops.
"""

import argparse
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

FOLDER = Path(__file__).parent
OURS = "minihuman/"
TIMEOUT_S = 900
PACKAGES = ("minihuman-lab", "minigrid", "gymnasium", "numpy", "torch", "torch-ac", "stable-baselines3", "memory-gym")
# Of a program with its arguments: what registers both packages' worlds, as `import minigrid` alone does theirs.
LOAD = "import runpy, sys, minigrid, minihuman; sys.argv = sys.argv[1:]; "
RUN_FILE = LOAD + "sys.path.insert(0, '.'); runpy.run_path(sys.argv[0], run_name='__main__')"
RUN_MODULE = LOAD + "sys.path.insert(0, '.'); runpy.run_module(sys.argv[0], run_name='__main__')"


@dataclass(frozen=True, slots=True)
class Repository:
    """A repository's commit, and the parts of it that a program needs."""

    owner: str
    name: str
    commit: str
    paths: tuple[str, ...]

    @property
    def url(self) -> str:
        """The page of the commit."""
        return f"https://github.com/{self.owner}/{self.name}/tree/{self.commit}"


STARTER = Repository(
    "lcswillems", "rl-starter-files", "317da04a9a6fb26506bbd7f6c7c7e10fc0de86e0", ("model.py", "scripts", "utils")
)
CLEANRL = Repository("vwxyzjn", "cleanrl", "fe8d8a03c41a7ef5b523e2e354bd01c363e786bb", ("cleanrl/ppo_trxl",))
MINIGRID = Repository(
    "Farama-Foundation", "Minigrid", "90928729376741a41222a257911343b97103b548", ("docs/content/training.md", "tests")
)


@dataclass(frozen=True, slots=True)
class Program:
    """A program of others.

    Attributes:
        run: runs it in its folder on a world and returns what is compared.
        changed: what is not as upstream has it, beside the id.
    """

    name: str
    repository: Repository
    worlds: tuple[str, ...]
    run: Callable[[Path, str], str]
    compared: str
    changed: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """What one program did on one world, there and here."""

    program: str
    world: str
    source: str
    compared: str
    changed: str
    verdict: str  # "equal" or "different"
    lines: int  # of what was compared
    difference: str  # the first; "" if there is none


def fetch(repository: Repository, source: str, folder: Path) -> None:
    """Put the named parts of a repository's commit into a folder."""
    where = source.format(owner=repository.owner, name=repository.name)
    if not Path(where).is_dir():
        clone = folder.with_suffix(".git")
        subprocess.run(["git", "clone", "-q", "--bare", "--filter=blob:none", where, str(clone)], check=True)
        where = str(clone)
    archive = ["git", "-C", where, "archive", repository.commit, *repository.paths]
    files = subprocess.run(archive, check=True, capture_output=True).stdout
    folder.mkdir()
    subprocess.run(["tar", "-x", "-C", str(folder)], input=files, check=True)


def run_python(folder: Path, *arguments: str) -> str:
    """Run Python in a folder; return what it printed."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "SDL_VIDEODRIVER": "dummy", "PYTHONWARNINGS": "ignore"}
    environment["PYTHONPATH"] = os.pathsep.join([str(FOLDER.parent), os.environ.get("PYTHONPATH", "")])
    process = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S
    )
    if process.returncode != 0:
        raise SystemExit(f"{arguments} failed:\n{process.stdout[-2000:]}\n{process.stderr[-4000:]}")
    return process.stdout


def train_starter_files(folder: Path, world: str) -> str:
    """Train and evaluate as the README of rl-starter-files has it, for a shorter time."""
    model = re.sub(r"\W", "-", world)
    train = ("scripts.train", "--algo", "ppo", "--env", world, "--model", model, "--procs", "2", "--frames", "512")
    run_python(folder, "-c", RUN_MODULE, *train, "--save-interval", "1", "--text", "--recurrence", "4")
    log = (folder / "storage" / model / "log.csv").read_text(encoding="utf-8").splitlines()
    is_kept = [name not in ("FPS", "duration") for name in log[0].split(",")]
    figures = [",".join(cell for cell, kept in zip(line.split(","), is_kept, strict=True) if kept) for line in log]
    evaluate = ("scripts.evaluate", "--env", world, "--model", model, "--procs", "2", "--episodes", "2")
    printed = run_python(folder, "-c", RUN_MODULE, *evaluate, "--text", "--memory")
    episodes = re.sub(r"FPS \d+ \| D \d+ \| ", "", printed).splitlines()
    digest = "import sys, torch, hashlib; state = torch.load(sys.argv[1], weights_only=False)['model_state']; "
    digest += "print(hashlib.sha256(b''.join(part.numpy().tobytes() for part in state.values())).hexdigest())"
    weights = run_python(folder, "-c", digest, f"storage/{model}/status.pt")
    return "\n".join([*figures, *episodes, weights])


# Gymnasium 1 reports the end of an episode in another form than 0.29, for which the program is written: there an
# environment is reset in the step that ends it, and `final_info` is a list.
VECTOR_OF_GYMNASIUM_029 = """
import gymnasium
from gymnasium.vector import AutoresetMode
Vector = gymnasium.vector.SyncVectorEnv
class SyncVectorEnv(Vector):
    def __init__(self, env_fns):
        super().__init__(env_fns, autoreset_mode=AutoresetMode.SAME_STEP)
    def step(self, actions):
        *returned, infos = super().step(actions)
        if "final_info" in infos:
            ended, episodes = infos["_final_info"], infos["final_info"]["episode"]
            parts = {key: episodes[key] for key in ("r", "l")}
            infos["final_info"] = [
                {"episode": {key: part[n] for key, part in parts.items()}} if ended[n] else None
                for n in range(self.num_envs)
            ]
        return (*returned, infos)
gymnasium.vector.SyncVectorEnv = SyncVectorEnv
"""


def train_transformer(folder: Path, world: str) -> str:
    """Train a small transformer of CleanRL's ppo_trxl."""
    load = VECTOR_OF_GYMNASIUM_029 + RUN_FILE
    size = ("--trxl-dim", "64", "--trxl-num-layers", "1", "--trxl-num-heads", "2", "--num-minibatches", "2")
    time = ("--num-envs", "2", "--num-steps", "128", "--total-timesteps", "768")
    options = ("ppo_trxl.py", "--env-id", world, "--no-cuda", *size, *time)
    printed = run_python(folder / "cleanrl" / "ppo_trxl", "-c", load, *options)
    lines = [line for line in printed.splitlines() if "pi_loss=" in line]
    return "\n".join(re.sub(r"SPS= *\d+ ", "", line) for line in lines)


KEYS = ("up", "up", "right", "up", "up", "left", "page up", "space", "page down", "backspace", "tab", "up")
PRESS_KEYS = """
import pygame
names = iter({keys})
def get(*_, **__):
    name = next(names, None)
    if name is None:
        raise SystemExit
    return [pygame.event.Event(pygame.KEYDOWN, key=pygame.key.key_code(name))]
pygame.event.get = get
"""


def control_by_hand(folder: Path, world: str) -> str:
    """Play with Minigrid's manual control, whose keys come one after the other."""
    load = LOAD + PRESS_KEYS.format(keys=KEYS)
    load += "runpy.run_module('minigrid.manual_control', run_name='__main__')"
    return run_python(folder, "-c", load, "manual_control", "--env-id", world, "--seed", "3")


TUTORIAL_IMPORTS = """
import gymnasium as gym
import torch
import torch.nn as nn
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
"""
PRINT_WEIGHTS = """
import hashlib
weights = b"".join(part.detach().numpy().tobytes() for part in model.policy.parameters())
print("weights", hashlib.sha256(weights).hexdigest())
"""


def follow_tutorial(folder: Path, world: str) -> str:
    """Train as the page "Training Minigrid Environments" has it, with a seed and for a shorter time."""
    page = (folder / "docs" / "content" / "training.md").read_text(encoding="utf-8")
    code = TUTORIAL_IMPORTS + "\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL)) + PRINT_WEIGHTS
    code = code.replace("MiniGrid-Empty-16x16-v0", world).replace("model.learn(2e5)", "model.learn(2048)")
    code = code.replace("verbose=1)", "verbose=1, seed=1)").replace("import minigrid\n", "import minigrid, minihuman\n")
    (folder / "tutorial.py").write_text(code, encoding="utf-8")
    printed = run_python(folder, "tutorial.py")
    return "\n".join(line for line in printed.splitlines() if "fps" not in line and "time_elapsed" not in line)


RECORD_ACTIONS = """
from minigrid.utils.baby_ai_bot import BabyAIBot
replan = BabyAIBot.replan
def replan_aloud(self, action=None):
    planned = replan(self, action)
    print("planned", int(planned))
    return planned
BabyAIBot.replan = replan_aloud
from tests.test_baby_ai_bot import test_bot
test_bot(sys.argv[0])
"""


def follow_bot(folder: Path, world: str) -> str:
    """Let Minigrid's test of its bot play a level to its success; the bot says what it plans."""
    return run_python(folder, "-c", LOAD + "sys.path.insert(0, '.')" + RECORD_ACTIONS, world)


PROGRAMS = (
    Program(
        "rl-starter-files, torch-ac: scripts.train, scripts.evaluate",
        STARTER,
        ("MiniGrid-DoorKey-5x5-v0",),
        train_starter_files,
        "figures of every update, weights, every evaluated episode",
        "nothing; 512 frames",
    ),
    Program(
        "CleanRL: ppo_trxl",
        CLEANRL,
        ("MiniGrid-MemoryS9-v0",),
        train_transformer,
        "figures of every update",
        "`SyncVectorEnv` resets and reports as Gymnasium 0.29's, for which it is written; 768 steps, a smaller network",
    ),
    Program(
        "Minigrid: manual_control",
        MINIGRID,
        ("MiniGrid-Empty-5x5-v0", "MiniGrid-DoorKey-5x5-v0"),
        control_by_hand,
        "what it prints after each of 12 keys",
        "nothing; its window has no display, its keys come from a list",
    ),
    Program(
        "Minigrid: tutorial with Stable-Baselines3",
        MINIGRID,
        ("MiniGrid-Empty-16x16-v0",),
        follow_tutorial,
        "what it prints, weights",
        "a seed; 2,048 steps; the imports that the page leaves out",
    ),
    Program(
        "Minigrid: test_baby_ai_bot",
        MINIGRID,
        ("BabyAI-GoToLocal-v0", "BabyAI-UnlockPickup-v0", "BabyAI-Synth-v0", "BabyAI-BossLevelNoUnlock-v0"),
        follow_bot,
        "every action that the bot plans, up to the first success",
        "nothing",
    ),
)


def compare(program: Program, world: str, folder: Path) -> Comparison:
    """Run a program on a world of Minigrid's and on ours."""
    theirs = program.run(folder, world).strip().splitlines()
    ours = [line.replace(OURS, "") for line in program.run(folder, OURS + world).strip().splitlines()]
    if len(theirs) != len(ours):
        difference = f"{len(theirs)} lines there, {len(ours)} here"
    else:
        difference = next((f"{a!r} there, {b!r} here" for a, b in zip(theirs, ours, strict=True) if a != b), "")
    verdict = "different" if difference or not theirs else "equal"
    return Comparison(
        *(program.name, world, program.repository.url, program.compared, program.changed, verdict),
        lines=len(theirs),
        difference=difference,
    )


def write_record(comparison: Comparison, folder: Path) -> None:
    """Write what was found, with versions and date; what is not run now stays."""
    path = folder / "upstream_programs.json"
    earlier = json.loads(path.read_text(encoding="utf-8"))["comparisons"] if path.exists() else []
    found = {(row["program"], row["world"]): row for row in [*earlier, asdict(comparison)]}
    order = [(program.name, world) for program in PROGRAMS for world in program.worlds]
    record = {
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "comparisons": [found[key] for key in order if key in found],
    }
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def write_page(folder: Path, page: Path) -> None:
    """Write the page from the record."""
    record = json.loads((folder / "upstream_programs.json").read_text(encoding="utf-8"))
    rows = [
        f"| [{row['program']}]({row['source']}) | `{row['world']}` | {row['compared']} | {row['changed']} "
        f"| {row['lines']} | {row['difference'].replace('|', '&#124;') or row['verdict']} |"
        for row in record["comparisons"]
    ]
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    page.write_text(
        _PAGE.format(rows="\n".join(rows), versions=versions, date=record["date"], python=record["python"]),
        encoding="utf-8",
    )


_PAGE = """# Programs written for Minigrid, on our worlds

Each was run twice: with the id that it has, and with `minihuman/` before it and `import minihuman` in the process that
runs it. *Compared* lines are equal to the last digit, or the first that differs is shown. Speeds and times of day are
left out. `python analysis/upstream_programs.py` fetches and runs them ({date}, Python {python}; {versions}).

| program | world | compared | changed beside the id | lines | |
|---|---|---|---|---|---|
{rows}
"""


def main() -> None:
    """Run what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", default="https://github.com/{owner}/{name}", help="of repositories")
    parser.add_argument("--only", nargs="*", metavar="WORD", help="in the names of programs to run; all without it")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write into")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as name:
        for program in PROGRAMS:
            if arguments.only and not any(word in program.name for word in arguments.only):
                continue
            folder = Path(name) / program.repository.name
            if not folder.exists():
                fetch(program.repository, arguments.source, folder)
            for world in program.worlds:
                comparison = compare(program, world, folder)
                print(comparison.verdict, program.name, world, comparison.lines, comparison.difference, flush=True)
                write_record(comparison, arguments.out)
                write_page(arguments.out, arguments.out / "upstream_programs.md")


if __name__ == "__main__":
    main()
