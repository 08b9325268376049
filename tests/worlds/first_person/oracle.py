"""Installed miniworld, run in a process of its own without pictures: jobs in on stdin, transcripts out on stdout.

Its drawing (display list, observation) is left out, which changes no rule: nothing in it is read back by a step. So
several worlds may share the process, and 50,000 steps are affordable.
"""

import contextlib
import io
import math
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from minihuman.worlds.trigonometry import cosine, sine

OWN = SimpleNamespace(**vars(math) | {"sin": sine, "cos": cosine})


@dataclass(frozen=True)
class Job:
    name: str  # "FourRooms"
    seed: int
    actions: tuple[int, ...]
    options: dict[str, Any] = field(default_factory=dict)
    own_sine: bool = False  # miniworld with its math.sin and math.cos replaced by ours


@dataclass(frozen=True)
class Transcript:
    walls: np.ndarray  # (n, 4) x0, z0, x1, z1
    things: list[tuple[float, ...]]  # x, y, z, dir, radius, height of every entity after the reset
    camera: tuple[float, ...]  # height, forward displacement, pitch, field of view
    light: tuple[float, ...]  # sky, position, colour, ambient
    poses: np.ndarray  # (steps + 1, 4) x, y, z, dir
    others: np.ndarray  # (steps + 1,) sum over all entities of place and heading: every one is in it
    rewards: list[float]
    flags: list[tuple[bool, bool]]


def transcripts(jobs: list[Job]) -> list[Transcript]:
    run = subprocess.run(
        [sys.executable, "-m", "tests.worlds.first_person.oracle"],
        input=pickle.dumps(jobs),
        stdout=subprocess.PIPE,
        check=True,
    )
    return pickle.loads(run.stdout)


def _play(job: Job, worlds: dict[Any, Any]) -> Transcript:
    import gymnasium
    import miniworld.entity
    import miniworld.math

    key = job.name, tuple(sorted(job.options.items()))
    if key not in worlds:
        worlds[key] = gymnasium.make(f"MiniWorld-{job.name}-v0", disable_env_checker=True, **job.options).unwrapped
    env = worlds[key]
    for module in (miniworld.entity, miniworld.math):
        module.math = OWN if job.own_sine else math
    env.reset(seed=job.seed)
    things = [(*map(float, e.pos), float(e.dir), float(e.radius), float(e.height)) for e in env.entities]
    agent = env.agent
    poses, others, rewards, flags = [_pose(agent)], [_sum(env)], [], []
    for action in job.actions:
        _, reward, terminated, truncated, _ = env.step(action)
        poses.append(_pose(agent))
        others.append(_sum(env))
        rewards.append(float(reward))
        flags.append((bool(terminated), bool(truncated)))
    return Transcript(
        walls=np.asarray(env.wall_segs)[:, :, [0, 2]].reshape(-1, 4),
        things=things,
        camera=(agent.cam_height, agent.cam_fwd_disp, agent.cam_pitch, agent.cam_fov_y),
        light=(*env.sky_color, *env.light_pos, *env.light_color, *env.light_ambient),
        poses=np.array(poses),
        others=np.array(others),
        rewards=rewards,
        flags=flags,
    )


def _pose(agent: Any) -> tuple[float, ...]:
    return (*map(float, agent.pos), float(agent.dir))


def _sum(env: Any) -> float:
    return sum(float(e.pos[0]) + 2 * float(e.pos[1]) + 3 * float(e.pos[2]) + 4 * float(e.dir) for e in env.entities)


def _serve() -> None:
    import pyglet

    pyglet.options["headless"] = True
    jobs = pickle.load(sys.stdin.buffer)
    with contextlib.redirect_stdout(io.StringIO()):
        import miniworld  # noqa: F401
        from miniworld.miniworld import MiniWorldEnv

        picture = np.zeros((60, 80, 3), np.uint8)
        MiniWorldEnv.render_obs = lambda self, frame_buffer=None: picture
        MiniWorldEnv._render_static = lambda self: None
        worlds: dict[Any, Any] = {}
        played = [_play(job, worlds) for job in jobs]
    sys.stdout.buffer.write(pickle.dumps(played))
    sys.stdout.flush()
    os._exit(0)  # pyglet's own shutdown wants its contexts back in an order we do not keep


if __name__ == "__main__":
    from tests.worlds.first_person import oracle  # under its own name, so that what it pickles can be found

    oracle._serve()
