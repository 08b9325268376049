"""Write the live gallery: worlds played from static files alone, by `python docs/gallery_live.py [FOLDER]`."""

import argparse
import hashlib
import json
import shutil
import warnings
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import minihuman
from minihuman.worlds.catalogue import BABYAI_WORLDS, FIRST_PERSON_WORLDS, GRID_WORLDS, CatalogueEntry
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.page_scene import describe
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

PAGE = Path(minihuman.__file__).parent / "web/page"
TILE_PX = 32
SIZE_PX = (640, 480)  # of a first-person picture


def write_gallery(folder: Path, seeds: int = 100, names: Collection[str] = ()) -> int:
    """Write the gallery into a folder, the first states of so many seeds per world; how many worlds it has.

    ``names`` are the worlds to write; none: all that a page can compute.
    """
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    shutil.copytree(Path(__file__).parent / "gallery-live", folder, dirs_exist_ok=True)
    shutil.copytree(PAGE / "worlds", folder / "worlds", dirs_exist_ok=True)
    shutil.copy(PAGE / "world.js", folder)
    worlds = []
    for kind, entries in (("Grid", GRID_WORLDS), ("BabyAI", BABYAI_WORLDS), ("First person", FIRST_PERSON_WORLDS)):
        for entry in entries:
            if names and entry.name not in names:
                continue
            env = _make_world(entry, {"trig": 1} if kind == "First person" else {})
            if not env.is_compiled:
                continue  # its rules are Python
            write = write_scenes if isinstance(env, FirstPersonEnv) else write_starts
            title = {"kind": kind, "title": f"{entry.name}: {entry.summary}"}
            worlds.append(title | {"actions": list(env.action_names)} | write(folder, env, entry, seeds))
    index = {"atlas": write_atlas(folder), "worlds": worlds}
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8")
    return len(worlds)


def _make_world(entry: CatalogueEntry, options: dict[str, Any]) -> Any:
    """Make a world; that there is a `-v1` of some is no news, since the gallery has both."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        return gymnasium.make(entry.id, **options).unwrapped


def write_starts(folder: Path, env: GridEngine, entry: CatalogueEntry, seeds: int) -> dict[str, Any]:
    """Pack a world's first states: the random streams of all seeds, then the rows, then the missions."""
    rows, words, missions = [], [], []
    for seed in range(seeds):
        observation, _ = env.reset(seed=seed)
        state = env.save()
        rows.append(state.row)
        words.append(state.rng_state)
        missions.append(observation["mission"])
    distinct = missions[:1] if len(set(missions)) == 1 else missions
    content = np.stack(words).tobytes() + np.stack(rows).tobytes() + json.dumps(distinct).encode()
    packed = zlib.compress(content, 9)
    (folder / "starts" / f"{entry.name}.z").write_bytes(packed)
    return {"name": entry.name, "seeds": seeds, "row_length": len(rows[0]), "view_size": env.image_shape[0]}


def write_scenes(folder: Path, env: FirstPersonEnv, entry: CatalogueEntry, seeds: int) -> dict[str, Any]:
    """Pack a world's first states and scenes: how long the head is, the head, and each different array once.

    The head is JSON: the kind and bytes of each array, and for each seed the numbers of its arrays by name, of how many
    things the scene is made, and the names of its textures, which are files of their own.
    """
    (folder / "textures").mkdir(exist_ok=True)
    arrays: dict[bytes, int] = {}
    kinds: list[str] = []

    def number(array: np.ndarray) -> int:
        content = array.tobytes()
        if content not in arrays:
            arrays[content] = len(arrays)
            kinds.append(str(array.dtype))
        return arrays[content]

    starts = []
    for seed in range(seeds):
        env.reset(seed=seed)
        state, scene, _ = describe(env, "classic", SIZE_PX)
        textures = []
        for pixels in scene.textures:
            textures.append(hashlib.sha256(pixels.tobytes()).hexdigest()[:16])
            path = folder / "textures" / f"{textures[-1]}.z"
            if not path.exists():
                path.write_bytes(zlib.compress(pixels.tobytes(), 9))
        names = ("things", "numbers", "walls", "words", "rooms", "edges")
        of_state = {name: number(array) for name, array in zip(names, state, strict=False)}
        of_scene = {name: number(array) for name, array in scene.tables.items()}
        mission = getattr(env, "mission", "") or entry.summary
        looks = {"looks": state.looks, "textures": textures, "mission": mission}
        starts.append({"state": of_state, "tables": of_scene} | looks)
    sizes = [[kind, len(content)] for kind, content in zip(kinds, arrays, strict=True)]
    head = json.dumps({"arrays": sizes, "starts": starts}).encode()
    content = len(head).to_bytes(4, "little") + head + b"".join(arrays)
    (folder / "starts" / f"{entry.name}.z").write_bytes(zlib.compress(content, 9))
    return {"name": entry.name, "seeds": seeds, "size_px": SIZE_PX}


def write_atlas(folder: Path) -> dict[str, Any]:
    """Pack the tiles, and say where each array of theirs begins."""
    drawn = atlas(TILE_PX, "classic")
    content, arrays = b"", {}
    for name in ("number", "under", "tiles", "agents", "carried"):
        array = getattr(drawn, name)
        array = array.view(np.uint8) if name == "tiles" else array
        arrays[name] = {"at": len(content), "bytes": array.nbytes, "kind": str(array.dtype)}
        content += array.tobytes()
    (folder / "atlas.z").write_bytes(zlib.compress(content, 9))
    return {"tile_px": TILE_PX, "small_px": drawn.carried.shape[1], "arrays": arrays}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("site"))
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--worlds", nargs="+", default=(), help="Only these.")
    given = parser.parse_args()
    count = write_gallery(given.folder, given.seeds, given.worlds)
    size = sum(path.stat().st_size for path in given.folder.rglob("*") if path.is_file())
    print(f"{count} worlds, {size / 1e6:.1f} MB in {given.folder}")
