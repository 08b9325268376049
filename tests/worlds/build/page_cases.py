"""Cases for the page's modules: first states and actions, and what Python makes of them."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.page_scene import copy_state, describe
from minihuman.worlds.first_person.state_digest import digest_state
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas
from minihuman.worlds.step_digest import digest_step


@dataclass(frozen=True)
class Extent:
    """How far a case goes."""

    steps: int = 200
    every: int = 10  # steps; a picture is drawn after so many
    size_px: tuple[int, int] = (80, 60)


USUAL, LARGE = Extent(), Extent(steps=20, every=1, size_px=(800, 600))


class Files:
    """Arrays as files of one folder, each content once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, array: Any, *, shared: bool = False) -> dict[str, Any]:
        """Write an array, and say where; those that many cases share are kept by who reads them."""
        array = np.ascontiguousarray(array)
        content = array.tobytes()
        name = f"{hashlib.sha256(content).hexdigest()[:24]}.bin"
        if not (self.folder / name).exists():
            (self.folder / name).write_bytes(content)
        return {"file": name, "kind": str(array.dtype), "shared": shared}


def _atlas_case(env: GridEngine, tile_px: int, files: Files) -> dict[str, Any]:
    drawn = atlas(tile_px, env.palette, env.kinds)
    names = "number", "under", "agents", "carried"
    arrays = {name: files.add(getattr(drawn, name), shared=True) for name in names}
    arrays["tiles"] = files.add(drawn.tiles.view(np.uint8), shared=True)
    return arrays | {"tile_px": tile_px, "small_px": drawn.carried.shape[1]}


def _tile_px(size_px: tuple[int, int], columns: int, rows: int) -> int:
    return max(1, min(size_px[0] // columns, size_px[1] // rows))


def page_case(
    env: GridEngine | FirstPersonEnv,
    seed: int,
    files: Files,
    name: str,
    extent: Extent = USUAL,
    actions: Sequence[Any] = (),
) -> tuple[dict[str, Any], str]:
    """A world's case for the page, and the digest of Python's own play; in first person, of given actions."""
    if isinstance(env, FirstPersonEnv):
        return _first_person_case(env, seed, files, name, extent, actions)
    return _grid_case(env, seed, files, name, extent)


def _grid_case(env: GridEngine, seed: int, files: Files, name: str, extent: Extent) -> tuple[dict[str, Any], str]:
    """Python plays through Gymnasium's interface."""
    env.reset(seed=seed)
    first = env.save()
    actions = np.random.default_rng(seed + 1).integers(0, env.action_space.n, extent.steps).tolist()
    size, size_px = env.image_shape[0], extent.size_px
    case = {
        "id": name,
        "every": extent.every,
        "start": {"row": files.add(first.row), "words": files.add(first.rng_state)},
        "view_size": size,
        "in_view": env.palette == "minigrid",
        "actions": actions,
        "atlas": _atlas_case(env, _tile_px(size_px, size, size), files),
        "full": _atlas_case(env, _tile_px(size_px, env.state.width, env.state.height), files),
    }
    digest = hashlib.sha256()
    for at, action in enumerate(actions):
        observation, reward, terminated, truncated, _ = env.step(action)
        now = env.save()
        digest.update(bytes([terminated | truncated << 1, observation["direction"]]))
        digest.update(np.float64(reward).tobytes() + now.row.tobytes() + now.rng_state.tobytes())
        digest.update(observation["image"].tobytes())
        outcome = np.array([np.float64(reward).view(np.uint64), 1 if terminated else 2 if truncated else 0], np.uint64)
        digest.update(f"{digest_step(now.row, observation['image'], outcome):016x}".encode())
        if at % extent.every == 0:
            digest.update(env.picture(view="partial", size_px=size_px).tobytes())
            digest.update(env.picture(view="full", size_px=size_px).tobytes())
        if terminated or truncated:
            env.restore(first)
    return case, digest.hexdigest()


def _first_person_case(
    env: FirstPersonEnv, seed: int, files: Files, name: str, extent: Extent, given: Sequence[Any]
) -> tuple[dict[str, Any], str]:
    env.reset(seed=seed)
    state, scene, _ = describe(env, "classic", extent.size_px)
    first, digest = env.save(), hashlib.sha256()
    actions = given or _seeking(env, seed, extent.steps)
    for at, action in enumerate(actions):
        reward, terminated, truncated = env.advance(as_action(env, action))
        outcome = np.array([np.float64(reward).view(np.uint64), 1 if terminated else 2 if truncated else 0], np.uint64)
        digest.update(bytes([terminated | truncated << 1]) + np.float64(reward).tobytes())
        digest.update(f"{digest_state(*copy_state(env), outcome):016x}".encode())
        if at % extent.every == 0:
            digest.update(env.picture(size_px=extent.size_px).tobytes())
        if terminated or truncated:
            env.restore(first)
    case = {
        "id": name,
        "every": extent.every,
        "state": {
            name: files.add(array)
            for name, array in zip(("things", "numbers", "walls", "words", "rooms", "edges"), state, strict=False)
        },
        "looks": state.looks,
        "tables": {name: files.add(array) for name, array in scene.tables.items()},
        "textures": [files.add(pixels, shared=True) for pixels in scene.textures],
        "size": extent.size_px,
        "actions": actions,
        "n_actions": len(env.kernel_actions),
        "uses": env.use_actions,
    }
    return case, digest.hexdigest()


def as_action(env: FirstPersonEnv, action: Any) -> Any:
    """An action as the world takes it, of a number or a flat vector."""
    if not isinstance(action, list):
        return action
    if env.use_actions:
        return {"move": np.array(action[:-1], np.float32), "use": int(action[-1])}
    return np.array(action, np.float32)


def _seeking(env: FirstPersonEnv, seed: int, steps: int) -> list[int]:
    """Actions of which most lead towards a thing that is near, and pick it up where that can be done."""
    rng, first, actions = np.random.default_rng(seed + 1), env.save(), []
    for _ in range(steps):
        x, _, z = env.agent.pos
        others = [thing for thing in env.entities if thing is not env.agent and thing is not env.agent.carrying]
        near = min(others, key=lambda thing: math.hypot(thing.pos[0] - x, thing.pos[2] - z), default=None)
        action = int(rng.integers(len(env.action_names)))
        if near is not None and rng.random() < 0.8:
            off = math.atan2(z - near.pos[2], near.pos[0] - x) - env.agent.dir
            off = (off + math.pi) % (2 * math.pi) - math.pi
            close = math.hypot(near.pos[0] - x, near.pos[2] - z) < 1.2 and "pickup" in env.action_names
            action = env.action_names.index("pickup") if close else 2 if abs(off) < 0.3 else 0 if off > 0 else 1
        actions.append(action)
        if any(env.advance(action)[1:]):
            env.restore(first)
    env.restore(first)
    return actions


def differing(expected: dict[str, str], found: dict[str, str]) -> Sequence[str]:
    """The ids whose digests are not equal."""
    return [name for name in expected if found.get(name) != expected[name]]
