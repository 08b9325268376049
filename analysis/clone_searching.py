"""Cloning FourRooms from people who search: by who demonstrated, how often, and what the clone remembers.

    python analysis/clone_searching.py OUT [--seeds 3] [--episodes 200] [--quick]

Writes points (`clone_searching.json`, one a clone; a run that is broken off goes on) and the table
(`clone_searching.md`) into OUT. The demonstrators are simulated participants, whose logs are kept in OUT/demos.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import torch

from cloning_curve import CloningPoint, run_cloning_curve
from minihuman.dataset.selection import Selection
from minihuman.learn.behaviour_cloning import CloningSettings, evaluate_policy, make_random_policy
from minihuman.learn.demonstrations import Demonstrations, read_demonstrations
from minihuman.learn.policy.network import EncoderName
from minihuman.learn.policy.observation import ObservationEncoder, ViewMode
from minihuman.statistics.scores import wilson_interval
from teaching_study.trials import describe_command, mean_interval

WORLD = "minihuman/MiniGrid-FourRooms-v0"
PROTOCOL = Path(__file__).with_suffix(".toml")
PLAYERS = ("human-like", "exploring", "optimal")
SIGHTS: dict[ViewMode, tuple[EncoderName, str]] = {
    "view": ("codes", "sees its view"),
    "remembered": ("near", "remembers"),
}
SIZES = (25, 50, 100, 200)
SETTINGS = CloningSettings(batch_size=128, most_epochs=40, patience=5)


def main(out: Path, *, seeds: int, episodes: int, quick: bool) -> None:
    """Let people demonstrate, clone, judge, write."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    sizes, participants = SIZES, 40
    if quick:
        sizes, participants = (4, 8), 3
    points = list[CloningPoint]()
    for sight, (eyes, words) in SIGHTS.items():
        for player in PLAYERS:
            logs = demonstrated(player, participants, out / "demos" / player)
            points = run_cloning_curve(
                {f"{player}, {words}": seen(logs, sight)},
                sizes=sizes,
                seeds=range(1, seeds + 1),
                eyes=eyes,
                episodes=episodes,
                settings=SETTINGS,
                kept=out / "clone_searching.json",
            )
    chance = of_chance(seen(out / "demos" / PLAYERS[0], "view"), episodes)
    text = table(points, sizes, chance, f"python analysis/clone_searching.py OUT --seeds {seeds} --episodes {episodes}")
    (out / "clone_searching.md").write_text(text)
    print(text)


def demonstrated(player: str, participants: int, data: Path) -> Path:
    """The logs of simulated participants, who play where there are none."""
    if not data.exists():
        run = ["simulate", str(PROTOCOL), "--participants", str(participants), "--player", player, "--data", str(data)]
        subprocess.run([sys.executable, "-m", "minihuman", *run], check=True, stdout=subprocess.DEVNULL)
    return data


def seen(logs: Path, sight: ViewMode) -> Demonstrations:
    """What ended at the goal, as a clone of that sight sees it."""
    return read_demonstrations(
        logs, WORLD, ObservationEncoder(missions=False, sight=sight), Selection(outcome=("goal",))
    )


def of_chance(like: Demonstrations, episodes: int) -> str:
    """How often any action at any time comes to the goal."""
    choose = make_random_policy(len(like.action_names), 1)
    return str(
        evaluate_policy(
            choose, WORLD, like.options, like.eyesight, episodes=episodes, seed=0, most_steps=like.most_steps
        )
    )


def table(points: list[CloningPoint], sizes: tuple[int, ...], chance: str, command: str) -> str:
    """Success by who demonstrated and how often, over the clones of all seeds."""
    seeds = len({point.seed for point in points})
    lines = [
        f"# Clones of {WORLD} from people who search",
        "",
        f"Success in {points[0].episodes} held-out episodes: the mean over clones of {seeds} seeds (first weights,",
        "order, who is held out), with a 95 % interval: Student's over clones or Wilson's over all their episodes,",
        "whichever is wider.",
        "",
        "| who demonstrated, what the clone sees | " + " | ".join(f"{size}" for size in sizes) + " |",
        "| --- |" + " --- |" * len(sizes),
    ]
    for source in dict.fromkeys(point.source for point in points):
        told = (said([one for one in points if (one.source, one.demonstrations) == (source, size)]) for size in sizes)
        lines.append(f"| {source} | " + " | ".join(told) + " |")
    lines += [f"| any action at any time | {chance} |" + " |" * (len(sizes) - 1), "", *describe_command(command)]
    return "\n".join(lines) + "\n"


def said(clones: list[CloningPoint]) -> str:
    """Their mean success with its interval; no narrower than if all episodes were one clone's."""
    if not clones:
        return "-"
    mean, low, high = mean_interval([one.successes / one.episodes for one in clones])
    least, most = wilson_interval(sum(one.successes for one in clones), sum(one.episodes for one in clones))
    return f"{mean:.2f} [{max(min(low, least), 0):.2f}, {min(max(high, most), 1):.2f}]"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--quick", action="store_true", help="tiny, to see that it runs")
    given = parser.parse_args()
    main(given.out, seeds=given.seeds, episodes=given.episodes, quick=given.quick)
