"""Draw one scene from random places with OpenGL and with us, in a process of its own; the differences as JSON."""

import json
import math
import sys
from pathlib import Path

import pyglet

pyglet.options["headless"] = True  # before miniworld opens its window

import gymnasium  # noqa: E402
import miniworld  # noqa: E402
import numpy as np  # noqa: E402

from minihuman.worlds.first_person.pictures import build_camera  # noqa: E402
from minihuman.worlds.first_person.render.drawing import render, render_depth  # noqa: E402

WIDTH, HEIGHT = 80, 60
QUANTUM = 1 / 65535 / 0.04  # one step of a 16-bit depth buffer with a near plane of 0.04 m, per squared metre


def differences(name: str, poses: int) -> dict[str, float]:
    theirs = gymnasium.make(f"MiniWorld-{name}-v0").unwrapped
    ours = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", assets=str(Path(miniworld.__file__).parent)).unwrapped
    theirs.reset(seed=5)
    ours.reset(seed=5)
    stage = ours.stage
    scene = ours._pictures.scene(stage)
    rng = np.random.default_rng(11)
    mean, far_off, depth_off = [], [], []
    for _ in range(poses):
        theirs.entities.remove(theirs.agent)
        theirs.place_agent()
        pos, heading = theirs.agent.pos, float(rng.uniform(-math.pi, math.pi))
        theirs.agent.dir = heading
        reference = theirs.render_obs().astype(int)
        distance = theirs.render_depth()[:, :, 0]
        eye = build_camera(stage, (float(pos[0]), float(pos[1]), float(pos[2])), heading)
        difference = np.abs(render(scene, eye, WIDTH, HEIGHT).astype(int) - reference)
        mean.append(difference.mean())
        far_off.append((difference.max(axis=2) > 16).mean())
        apart = np.abs(render_depth(scene, eye, WIDTH, HEIGHT) - distance)
        depth_off.append((apart > 0.01 * distance + QUANTUM * distance**2).mean())
    return {
        "mean": float(np.mean(mean)),
        "far_off": float(np.mean(far_off)),
        "depth_off": float(np.mean(depth_off)),
    }


if __name__ == "__main__":
    print(json.dumps(differences(sys.argv[1], int(sys.argv[2]))))
