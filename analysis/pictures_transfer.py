"""Whether a policy trained on Miniworld's own pictures plays ours, and the other way round.

    python analysis/pictures_transfer.py [OUT] [--episodes 150] [--tests 100]

In MiniWorld-OneRoom both worlds are in the same state at every step; only their pictures differ. What is learnt from
is somebody who turns right until the box is in view, then towards it, and walks to it. One network is fitted to the
same steps by Miniworld's pictures, and one by ours; both then play the same new episodes by both. OUT gets the
successes; printed are Wilson's intervals of 95 %, too.
"""

import argparse
import contextlib
import io
import json
import math
from importlib.metadata import version
from pathlib import Path

import gymnasium
import numpy as np
import pyglet
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.statistics.scores import wilson_interval

pyglet.options["headless"] = True  # before miniworld opens its window

WORLD, MOST_STEPS = "MiniWorld-OneRoom-v0", 180
TURN_LEFT, TURN_RIGHT, FORWARD = 0, 1, 2
IN_VIEW_RAD = 0.55  # to either side of where one looks: the picture ends at 0.65
STRAIGHT_RAD = 0.2  # a turn is 0.26
Pictures = NDArray[np.uint8]


def worlds() -> dict[str, gymnasium.Env]:
    """The same world, drawn by OpenGL and by us."""
    with contextlib.redirect_stdout(io.StringIO()):
        import miniworld  # noqa: F401  registers the worlds
    import minihuman  # noqa: F401

    made = {"miniworld": WORLD, "minihuman": f"minihuman/{WORLD}"}
    return {name: gymnasium.make(world, disable_env_checker=True).unwrapped for name, world in made.items()}


def step_towards_the_box(world: gymnasium.Env) -> int:
    """What somebody does who cannot see behind them."""
    pose, (x, _, z) = world.pose(), world.box.pos
    left = math.remainder(math.atan2(pose.z - z, x - pose.x) - pose.yaw_rad, math.tau)
    if abs(left) <= STRAIGHT_RAD:
        return FORWARD
    return TURN_LEFT if 0.0 < left <= IN_VIEW_RAD else TURN_RIGHT


def demonstrations(both: dict[str, gymnasium.Env], episodes: int) -> tuple[dict[str, Pictures], NDArray[np.int64]]:
    """The pictures of both before every step that somebody took, and the steps."""
    seen: dict[str, list[Pictures]] = {name: [] for name in both}
    taken = []
    for seed in range(episodes):
        pictures = {name: env.reset(seed=seed)[0] for name, env in both.items()}
        over = False
        while not over:
            action = step_towards_the_box(both["minihuman"])
            taken.append(action)
            for name, env in both.items():
                seen[name].append(pictures[name])
                pictures[name], _, terminated, truncated, _ = env.step(action)
                over = terminated or truncated
    return {name: np.array(each) for name, each in seen.items()}, np.array(taken)


def fitted(pictures: Pictures, taken: NDArray[np.int64], *, epochs: int, seed: int) -> nn.Module:
    """A network of three convolutions that does what was done."""
    torch.manual_seed(seed)
    network = nn.Sequential(
        *(nn.Conv2d(3, 16, 8, stride=4), nn.ReLU(), nn.Conv2d(16, 32, 4, stride=2), nn.ReLU()),
        *(nn.Conv2d(32, 32, 3), nn.ReLU(), nn.Flatten(), nn.Linear(32 * 6 * 4, 64), nn.ReLU(), nn.Linear(64, 3)),
    )
    optimiser = torch.optim.Adam(network.parameters(), 1e-3)
    inputs, wanted = torch.from_numpy(pictures).permute(0, 3, 1, 2), torch.from_numpy(taken)
    for _ in range(epochs):
        for rows in torch.randperm(len(wanted)).split(64):
            loss = nn.functional.cross_entropy(network(inputs[rows].float() / 255.0), wanted[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    return network


@torch.no_grad()
def successes(network: nn.Module, env: gymnasium.Env, episodes: int) -> int:
    """In how many new episodes it reaches the box; it draws its actions, seeded."""
    reached = 0
    for seed in range(10_000, 10_000 + episodes):
        draw = torch.Generator().manual_seed(seed)
        picture, _ = env.reset(seed=seed)
        for _ in range(MOST_STEPS):
            chances = network(torch.from_numpy(picture.copy()).permute(2, 0, 1)[None].float() / 255.0).softmax(1)
            picture, reward, terminated, truncated, _ = env.step(int(torch.multinomial(chances[0], 1, generator=draw)))
            if terminated or truncated:
                reached += reward > 0
                break
    return reached


def main(out: Path, *, episodes: int, tests: int, epochs: int) -> None:
    torch.set_num_threads(1)
    both = worlds()
    pictures, taken = demonstrations(both, episodes)
    found = []
    for learnt_from in both:
        network = fitted(pictures[learnt_from], taken, epochs=epochs, seed=1)
        for played_by in both:
            reached = successes(network, both[played_by], tests)
            low, high = wilson_interval(reached, tests)
            found.append({"learnt_from": learnt_from, "played_by": played_by, "reached": reached, "of": tests})
            print(f"learnt from {learnt_from}, played by {played_by}: {reached} of {tests} [{low:.3f}, {high:.3f}]")
    apart = float(np.abs(pictures["miniworld"].astype(int) - pictures["minihuman"]).mean())
    packages = {name: version(name) for name in ("minihuman-lab", "miniworld", "torch", "numpy")}
    result = {"world": WORLD, "steps": len(taken), "episodes": episodes, "mean_difference": round(apart, 2)}
    out.write_text(json.dumps({**result, "versions": packages, "found": found}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--episodes", type=int, default=150)
    parser.add_argument("--tests", type=int, default=100)
    parser.add_argument("--epochs", type=int, default=10)
    given = parser.parse_args()
    main(given.out, episodes=given.episodes, tests=given.tests, epochs=given.epochs)
