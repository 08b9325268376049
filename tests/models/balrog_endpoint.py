"""One scripted endpoint plays the same levels in BALROG and here: the same actions, steps and progression in both.

    python -m tests.models.balrog_endpoint BALROG MINIGRID PYTHON [EPISODES]

BALROG and MINIGRID are checkouts of github.com/balrog-ai/BALROG and github.com/BartekCupial/Minigrid; PYTHON is that of
an environment with BALROG's requirements (openai, anthropic, google-genai, omegaconf, tqdm, gym, gymnasium, pillow).
The endpoint knows an episode's mission and the words of what is seen, whichever program asks; EPISODES are so many of
each of five levels. BALROG's prompts, agent, client and evaluator are its own.
"""

import csv
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from minihuman import simulate, verify
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.read.session_reader import read_log
from tests.models.balrog_progression import BLOCK, LEVELS, STUDY
from tests.models.endpoint import KEY, serve_endpoint, text_of

ACTIONS = {
    "left": "turn left",
    "right": "turn right",
    "forward": "go forward",
    "pickup": "pick up",
    "drop": "drop",
    "toggle": "toggle",
}
_THING = re.compile(r"(?:(red|green|blue|purple|yellow|grey) )?(ball|box|key|door)")
_PLACE = re.compile(r"(\d+) steps? (left|right|forward)")


def choose(mission: str, seen: list[str]) -> str:
    """Go to the first thing that the mission names and use it; while it is not seen, wander as a digest says."""
    found = _THING.search(mission)
    colour, kind = found.groups(default="") if found else ("", "")
    ahead = ""
    target: dict[str, int] = {}
    for line in seen:
        steps = {side: int(number) for number, side in _PLACE.findall(line)}
        if steps == {"forward": 1}:
            ahead = line
        if not target and kind and kind in line and colour in line and steps:
            target = steps
    digest = hashlib.sha256("\n".join([mission, *seen]).encode()).digest()[0]
    if target == {"forward": 1}:
        carries = any(line.startswith("You carry") for line in seen)
        return "toggle" if mission.startswith("open") else "drop" if carries else "pickup"
    if target.get("forward") and not ahead:
        return "forward"
    for side in ("left", "right"):
        if side in target and (ahead or not target.get("forward")):
            return side
    return ("left", "right", "toggle")[digest % 3] if ahead else ("left", "right", "forward", "forward")[digest % 4]


def reply(messages: list[dict[str, Any]], number: int) -> str:
    """The action's name for BALROG, and the line that a protocol asks for here."""
    text, first = text_of(messages), text_of(messages[:1])
    seen = [line for line in text.splitlines() if re.match(r"(a \w|You carry)", line)]
    if found := re.search(r"Your goal is to (.*)\. The following are the possible actions", first):
        return ACTIONS[choose(found[1].lower(), seen)]
    lines = text.splitlines()
    legend = next(line for line in lines if " = " in line)
    mission = lines[lines.index(legend) - 2]
    keys = {action: key for key, _, action in (one.partition(" = ") for one in legend.split(", "))}
    return f"Answer: {keys[choose(mission.lower(), seen)]}"


def play_here(folder: Path, *, episodes: int) -> list[EpisodeLog]:
    """So many episodes of each level, by the endpoint."""
    blocks = "".join(BLOCK.format(name=name.lower(), level=name, episodes=episodes) for name in LEVELS)
    model = '[model]\nmodality = "text"\n[keys]'
    text = STUDY.format(names=[name.lower() for name in LEVELS]).replace("[keys]", model) + blocks
    (folder / "study.toml").write_text(text)
    (path,) = simulate(folder / "study.toml", participants=1, data=folder / "data", player="model:scripted")
    assert [line.text for line in verify(path) if not line.ok] == []
    return list(read_log(path).episodes)


def find_difference(episode: EpisodeLog, run: Path) -> str:
    """Where BALROG's run of an episode is not ours; "" where it is."""
    there = json.loads(run.read_text())
    rows = list(csv.DictReader(run.with_suffix(".csv").open(encoding="utf-8", newline="")))
    actions = [ACTIONS[episode.start.action_names[action]] for action in episode.actions]
    ours = float(episode.outcome == "goal"), len(actions), actions
    theirs = there["progression"], there["num_steps"], [row["Action"] for row in rows]
    return "" if ours == theirs else f"{episode.plan.world} {episode.plan.seed}: {ours} here, {theirs} there"


def main(balrog: str, minigrid: str, python: str, episodes: str = "10") -> int:
    with tempfile.TemporaryDirectory() as name, serve_endpoint(reply) as endpoint:
        folder, out = Path(name), Path(name) / "balrog"
        os.environ |= {"OPENAI_BASE_URL": endpoint.url, "OPENAI_API_KEY": KEY}
        played = play_here(folder, episodes=int(episodes))
        asked = len(endpoint.requests)
        wanted = [(one.plan.world.removeprefix("minihuman/"), one.plan.seed) for one in played]
        script = Path(__file__).with_name("balrog_evaluator.py")
        command = [python, str(script), balrog, minigrid, str(out)]
        subprocess.run(command, input=json.dumps(wanted), text=True, check=True, cwd=folder, stderr=subprocess.DEVNULL)
        runs = [out / "babyai" / level / f"{level}_run_{number:02d}.json" for number, (level, _) in enumerate(wanted)]
        different = list(filter(None, map(find_difference, played, runs)))
        there = sum(json.loads(run.read_text())["progression"] for run in runs)
        both = f"{asked} requests here, {len(endpoint.requests) - asked} there"
    here = sum(one.outcome == "goal" for one in played)
    print(f"{len(played)} episodes of {len(LEVELS)} levels, {both}")
    print(f"mean progression {here / len(played):.3f} here, {there / len(played):.3f} there; {len(different)} differ")
    print("\n".join(different), end="")
    return bool(different)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
