"""Draw the pairs of first-person pictures that new readers compare: ours (`look = "display"`) and Miniworld's own.

python analysis/readers/looks.py FOLDER --seed 1 [--pairs 12]

Each pair shows one state: the same world, layout and pose, after some steps drawn by the seed, at 800 x 600. Which of
the two is ``A`` is drawn as well; `key.json` says it, and is not shown to readers. `README.md` has their prompt.
"""

import argparse
import json
import random
from pathlib import Path

import gymnasium
import numpy as np
import pyglet
from PIL import Image

pyglet.options["headless"] = True

import miniworld  # noqa: E402, F401 (its windows read the option above when they are imported)

import minihuman  # noqa: E402, F401

SIZE_PX = (800, 600)
MOST_STEPS = 12


def main() -> None:
    """Read the command line and write the pairs."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--seed", type=int, required=True)
    arguments.add_argument("--pairs", type=int, default=12)
    chosen = arguments.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    draw = random.Random(chosen.seed)
    names = sorted(each for each in gymnasium.registry if each.startswith("MiniWorld-"))
    key = {}
    for number, name in enumerate(draw.sample(names, chosen.pairs), 1):
        seed, steps = draw.randrange(10_000), draw.randrange(2, MOST_STEPS + 1)
        actions = [draw.choice((0, 1, 2, 2, 2)) for _ in range(steps)]
        theirs, ours = pictures(name, seed, actions)
        is_first = draw.random() < 0.5
        for letter, picture in zip("AB", (ours, theirs) if is_first else (theirs, ours), strict=True):
            Image.fromarray(picture).save(chosen.folder / f"{number:02}-{letter}.png")
        key[f"{number:02}"] = {"world": name, "seed": seed, "actions": actions, "ours": "A" if is_first else "B"}
    (chosen.folder / "key.json").write_text(json.dumps(key, indent=1) + "\n", encoding="utf-8")


def pictures(name: str, seed: int, actions: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Miniworld's picture and ours of the state after some actions.

    Raises:
        RuntimeError: if the two agents do not stand where the other does.
    """
    theirs = gymnasium.make(name, render_mode="rgb_array", window_width=SIZE_PX[0], window_height=SIZE_PX[1])
    ours = gymnasium.make(f"minihuman/{name}", look="display")
    for world in (theirs, ours):
        world.reset(seed=seed)
        for action in actions:
            _, _, terminated, truncated, _ = world.step(action)
            if terminated or truncated:
                break
    where = [np.append(world.unwrapped.agent.pos, world.unwrapped.agent.dir) for world in (theirs, ours)]
    if not np.allclose(*where, atol=1e-6):
        raise RuntimeError(f"{name}, seed {seed}: Miniworld's agent is at {where[0]}, ours at {where[1]}")
    return np.asarray(theirs.render()), ours.unwrapped.picture(size_px=SIZE_PX)


if __name__ == "__main__":
    main()
