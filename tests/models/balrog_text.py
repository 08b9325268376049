"""The words of 10,000 BabyAI states as the Minigrid that BALROG installs describes them, as committed digests.

    python -m tests.models.balrog_text FOLDER

FOLDER is a checkout of github.com/BartekCupial/Minigrid, which BALROG's babyai environment builds on (its wrapper takes
"You see " off each line). The package there is imported in place of an installed one.
"""

import hashlib
import sys
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

LEVELS = ("GoToLocal", "GoTo", "PickupLoc", "Open", "PutNextLocal", "UnblockPickup", "Synth", "BossLevel")
STATES, STATES_PER_DIGEST = 10_000, 50
DIGESTS = Path(__file__).with_name("balrog_digests.txt")
Describe = Callable[[dict[str, Any], dict[str, Any]], list[str]]  # of observation and info


def describe_states(prefix: str, describe: Describe) -> Iterator[list[str]]:
    """The words of each state of random episodes, one level after the other."""
    rng = np.random.default_rng(1)
    for seed, level in enumerate(cycle(LEVELS)):
        env = gymnasium.make(f"{prefix}BabyAI-{level}-v0", disable_env_checker=True)
        observation, info = env.reset(seed=seed)
        for _ in range(60):
            yield describe(observation, info)
            observation, _, terminated, truncated, info = env.step(int(rng.integers(6)))
            if terminated or truncated:
                break
        env.close()


def digest_states(states: Iterator[list[str]]) -> list[str]:
    """A digest of every 50 states."""
    texts = ["\n".join(lines) for lines in islice(states, STATES)]
    packs = [texts[first : first + STATES_PER_DIGEST] for first in range(0, STATES, STATES_PER_DIGEST)]
    return [hashlib.sha256("\n\n".join(pack).encode()).hexdigest()[:16] for pack in packs]


if __name__ == "__main__":
    folder = Path(sys.argv[1]).resolve()
    sys.path.insert(0, str(folder))
    import minigrid

    assert Path(minigrid.__file__).is_relative_to(folder), f"{folder} holds no minigrid"
    minigrid.register_minigrid_envs()
    theirs = describe_states("", lambda _, info: [line.replace("You see ", "") for line in info["descriptions"]])
    DIGESTS.write_text("\n".join(digest_states(theirs)) + "\n")
