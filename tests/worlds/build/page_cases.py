"""Cases for the page's modules: first states and actions, and what Python makes of them."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.render.drawing import MOST_SPANS
from minihuman.worlds.grid.core.digest import digest_step
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

STEPS, EVERY = 200, 10  # steps of a case; a picture is drawn after so many
SIZE_PX = 80, 60


class Files:
    """Arrays as files of one folder, each content once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, array: Any) -> dict[str, str]:
        """Write an array, and say where."""
        array = np.ascontiguousarray(array)
        content = array.tobytes()
        name = f"{hashlib.sha256(content).hexdigest()[:24]}.bin"
        if not (self.folder / name).exists():
            (self.folder / name).write_bytes(content)
        return {"file": name, "kind": str(array.dtype)}


def _atlas_case(env: GridEngine, tile_px: int, files: Files) -> dict[str, Any]:
    drawn = atlas(tile_px, env.palette, env.kinds)
    names = "number", "under", "agents", "carried"
    arrays = {name: files.add(getattr(drawn, name)) for name in names}
    arrays["tiles"] = files.add(drawn.tiles.view(np.uint8))
    return arrays | {"tile_px": tile_px, "small_px": drawn.carried.shape[1]}


def _tile_px(columns: int, rows: int) -> int:
    return max(1, min(SIZE_PX[0] // columns, SIZE_PX[1] // rows))


def grid_case(env: GridEngine, seed: int, files: Files, name: str) -> tuple[dict[str, Any], str]:
    """A world's case for the page, and the digest of Python's own play through Gymnasium's interface."""
    env.reset(seed=seed)
    first = env.save()
    actions = np.random.default_rng(seed + 1).integers(0, env.action_space.n, STEPS).tolist()
    size = env.image_shape[0]
    case = {
        "id": name,
        "row": files.add(first.row),
        "words": files.add(first.rng_state),
        "view_size": size,
        "in_view": env.palette == "minigrid",
        "actions": actions,
        "atlas": _atlas_case(env, _tile_px(size, size), files),
        "full": _atlas_case(env, _tile_px(env.state.width, env.state.height), files),
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
        if at % EVERY == 0:
            digest.update(env.picture(view="partial", size_px=SIZE_PX).tobytes())
            digest.update(env.picture(view="full", size_px=SIZE_PX).tobytes())
        if terminated or truncated:
            env.restore(first)
    return case, digest.hexdigest()


def scene_case(env: FirstPersonEnv, seed: int, files: Files, name: str) -> tuple[dict[str, Any], str]:
    """What a first-person world's renderer is given every tenth step, and the digest of Python's pictures."""
    env.reset(seed=seed)
    target = env.aim_target()
    layout = target.layout
    actions = np.random.default_rng(seed + 1).integers(0, len(env.action_names), STEPS).tolist()
    views, places, digest = [], [], hashlib.sha256()
    for at, action in enumerate(actions):
        _, terminated, truncated = env.advance(action)
        if at % EVERY == 0:
            now = env.aim_target()
            if now.layout is not layout:
                break
            views.append(now.view.copy())
            places.append(now.places.copy())
            digest.update(env.see().tobytes())
        if terminated or truncated:
            break
    tables = dict(
        zip(("room_floats", "room_wholes"), layout.packed_rooms, strict=True),
        **dict(zip(("library_floats", "library_wholes"), layout.packed_library, strict=True)),
        things=layout.things,
        view=target.view,
    )
    case = {
        "id": name,
        "tables": {key: files.add(array) for key, array in tables.items()},
        "texels": files.add(layout.textures.texels),
        "table": files.add(layout.textures.table),
        "things": layout.thing_count,
        "width": target.size_px[0],
        "height": target.size_px[1],
        "room": [int(number) for number in target.room()],
        "views": files.add(np.stack(views)),
        "places": files.add(np.stack(places)),
        "pictures": len(views),
        "spans": MOST_SPANS,
    }
    return case, digest.hexdigest()


def differing(expected: dict[str, str], found: dict[str, str]) -> Sequence[str]:
    """The ids whose digests are not equal."""
    return [name for name in expected if found.get(name) != expected[name]]
