"""Write the live gallery: every grid world played from static files, by `python docs/gallery_live.py [FOLDER]`."""

import argparse
import json
import shutil
import zlib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import minihuman
from minihuman.worlds.catalogue import BABYAI_WORLDS, GRID_WORLDS
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

PAGE = Path(minihuman.__file__).parent / "web/page"
TILE_PX = 32


def write_gallery(folder: Path, seeds: int = 100) -> int:
    """Write the gallery into a folder, the first states of so many seeds per world; how many worlds it has."""
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    shutil.copytree(Path(__file__).parent / "gallery-live", folder, dirs_exist_ok=True)
    shutil.copytree(PAGE / "worlds", folder / "worlds", dirs_exist_ok=True)
    shutil.copy(PAGE / "world.js", folder)
    worlds = []
    for entry in (*GRID_WORLDS, *BABYAI_WORLDS):
        env = gymnasium.make(entry.id).unwrapped
        if not env.is_compiled:
            continue  # its rules are Python
        worlds.append(write_starts(folder, env, entry.name, seeds) | {"title": f"{entry.name}: {entry.summary}"})
    index = {"atlas": write_atlas(folder), "worlds": worlds}
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8")
    return len(worlds)


def write_starts(folder: Path, env: GridEngine, name: str, seeds: int) -> dict[str, Any]:
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
    (folder / "starts" / f"{name}.z").write_bytes(packed)
    return {
        "name": name,
        "seeds": seeds,
        "row_length": len(rows[0]),
        "view_size": env.image_shape[0],
        "actions": list(env.action_names),
    }


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
    given = parser.parse_args()
    count = write_gallery(given.folder, given.seeds)
    size = sum(path.stat().st_size for path in given.folder.rglob("*") if path.is_file())
    print(f"{count} worlds, {size / 1e6:.1f} MB in {given.folder}")
