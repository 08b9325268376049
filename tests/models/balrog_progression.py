"""The same actions make the same progress in BALROG's BabyAI as here: reward by reward, episode by episode.

    python -m tests.models.balrog_progression [FOLDER]

FOLDER is a checkout of github.com/BartekCupial/Minigrid, which BALROG's babyai environment builds on; without it, the
installed minigrid is compared with. BALROG's wrapper calls an episode's progression 1 once a reward is above 0. The
actions are those of sessions here: of the planner, and of the random player, who seldom gets there.
"""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import gymnasium

from minihuman import simulate
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.read.session_reader import read_log

LEVELS = ("GoToLocal", "PickupLoc", "PutNextLocal", "OpenDoor", "GoTo")
STUDY = """
[study]
name = "progression"
version = "1"
seed = 2
participants = 20
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = {names}
"""
BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/BabyAI-{level}-v0"
actions = ["left", "right", "forward", "pickup", "drop", "toggle"]
max_steps = 60
key_map = "shown"
episodes = {episodes}
"""


def play_episodes(folder: Path, *, episodes: int) -> Iterator[EpisodeLog]:
    """So many of each level, by the planner and by the random player."""
    blocks = "".join(BLOCK.format(name=name.lower(), level=name, episodes=episodes) for name in LEVELS)
    (folder / "study.toml").write_text(STUDY.format(names=[name.lower() for name in LEVELS]) + blocks)
    for player in ("optimal", "random"):
        for path in simulate(folder / "study.toml", participants=1, data=folder / "data", player=player):
            yield from read_log(path).episodes


def find_difference(episode: EpisodeLog) -> str:
    """Where the other environment's rewards, ends or progression are not ours; "" where they are."""
    env = gymnasium.make(episode.plan.world.removeprefix("minihuman/"), disable_env_checker=True)
    env.reset(seed=episode.plan.seed)
    progression, ours = 0.0, float(episode.outcome == "goal")
    for step, action in enumerate(episode.actions):
        _, reward, terminated, _, _ = env.step(int(action))
        progression = 1.0 if reward > 0 else progression
        if (float(reward), terminated) != (episode.rewards[step], episode.terminated[step]):
            return f"{episode.plan.world} {episode.plan.seed}, step {step + 1}: {reward} {terminated} there"
    env.close()
    return "" if progression == ours else f"{episode.plan.world} {episode.plan.seed}: progression {progression} there"


def compare(*, episodes: int) -> tuple[int, int, list[str]]:
    """The number of episodes, of those that reached the goal, and the differences."""
    with tempfile.TemporaryDirectory() as folder:
        played = list(play_episodes(Path(folder), episodes=episodes))
    found = [find_difference(episode) for episode in played]
    return len(played), sum(episode.outcome == "goal" for episode in played), [one for one in found if one]


if __name__ == "__main__":
    if len(sys.argv) > 1:
        sys.path.insert(0, str(Path(sys.argv[1]).resolve()))
    import minigrid

    minigrid.register_minigrid_envs()
    count, reached, different = compare(episodes=13)
    print(f"minigrid {minigrid.__version__}: {count} episodes, {reached} reached the goal, {len(different)} differ")
    print("\n".join(different), end="")
    sys.exit(bool(different))
