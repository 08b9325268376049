"""Imitation by number of demonstrations (BabyAI's question), for three kinds of demonstrators, from one command.

    python analysis/imitation_curve.py OUT [--seeds 3] [--episodes 512] [--quick]

Writes points (JSON, one a clone; a run that is broken off goes on), the table (CSV) and the figure into OUT. Two kinds
are simulated participants, whose logs are kept in OUT; the third is the bot of `minigrid`, which has to be installed.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

import minihuman  # noqa: F401  # registers the worlds
from cloning_curve import build_curve_table, curve_figure, run_cloning_curve
from minihuman.dataset.selection import Selection
from minihuman.figures.style import save_figure
from minihuman.learn.behaviour_cloning import CloningSettings
from minihuman.learn.demonstrations import Demonstration, Demonstrations, read_demonstrations
from minihuman.learn.policy.observation import ObservationEncoder

LEVEL = "BabyAI-GoToRedBallGrey-v0"
PROTOCOL = Path(__file__).with_suffix(".toml")
EYESIGHT = ObservationEncoder(missions=False)
TURNS = 160  # episodes of a participant, simulated or a name of the bot's


def simulated(player: str, participants: int, out: Path, protocol: Path) -> Demonstrations:
    """What simulated participants did, where it ended at the goal."""
    data = out / player
    if not data.exists():
        run = ["simulate", str(protocol), "--participants", str(participants), "--player", player, "--data", str(data)]
        subprocess.run([sys.executable, "-m", "minihuman", *run], check=True, stdout=subprocess.DEVNULL)
    return read_demonstrations(data, f"minihuman/{LEVEL}", EYESIGHT, Selection(outcome=("goal",)))


def bot(like: Demonstrations, count: int, turns: int) -> Demonstrations:
    """What the bot of Minigrid does, in Minigrid's own world."""
    import minigrid  # noqa: F401  # registers it
    from minigrid.utils.baby_ai_bot import BabyAIBot

    env: Any = gymnasium.make(LEVEL)
    episodes = []
    for seed in range(count):
        raw, _ = env.reset(seed=seed)
        mind, actions, seen, ended, reward = BabyAIBot(env.unwrapped), [], [], False, 0.0
        while not ended:
            action = mind.replan(None if not actions else actions[-1])
            seen.append(EYESIGHT.encode(env.unwrapped, raw))
            actions.append(int(action))
            raw, reward, terminated, truncated, _ = env.step(action)
            ended = terminated or truncated
        if reward > 0 and max(actions) < len(like.action_names):
            who = f"bot-{len(episodes) // turns:02d}"
            episodes.append(Demonstration(who, "bot", np.array(actions), tuple(seen)))
    return Demonstrations(
        like.world,
        like.options,
        like.action_names,
        like.most_steps,
        like.eyesight,
        like.space,
        tuple(episodes),
        like.account,
    )


def main(out: Path, *, seeds: int, episodes: int, quick: bool) -> None:
    """Make the demonstrations, clone, judge, write."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    sizes, participants, turns, protocol = tuple(2**k for k in range(9, 14)), 64, TURNS, PROTOCOL
    if quick:
        sizes, participants, turns, protocol = (16, 32), 2, 40, out / "quick.toml"
        protocol.write_text(PROTOCOL.read_text().replace(f"episodes = {TURNS}", f"episodes = {turns}"))
    exploring = simulated("exploring", participants, out, protocol)
    sources = {
        "exploring expert": exploring,
        "human-like": simulated("human-like", participants, out, protocol),
        "Minigrid's bot": bot(exploring, participants * turns, turns),
    }
    points = run_cloning_curve(
        sources,
        sizes=sizes,
        seeds=range(1, seeds + 1),
        eyes="grid",
        episodes=episodes,
        settings=CloningSettings(validation_share=0.1, most_epochs=30, patience=3, batch_size=256),
        kept=out / "points.json",
    )
    table = build_curve_table(points)
    table.round(4).to_csv(out / "curve.csv", index=False)
    save_figure(curve_figure(table, title=f"Clones of {LEVEL}, {seeds} a point"), out / "curve")
    print(table.round(3).to_string(index=False))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=512)
    parser.add_argument("--quick", action="store_true", help="tiny, to see that it runs")
    given = parser.parse_args()
    main(given.out, seeds=given.seeds, episodes=given.episodes, quick=given.quick)
