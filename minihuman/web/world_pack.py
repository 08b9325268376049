"""Packs worlds for pages without a server: compiled rules, tiles, textures and the first states of some seeds.

`minihuman pack` and the live gallery write these folders; `page/packed_world.js` plays from them, in a page or in Node.
"""

import hashlib
import json
import re
import shutil
import warnings
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.catalogue import BABYAI_WORLDS, FIRST_PERSON_WORLDS, GRID_WORLDS, CatalogueEntry
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.page_scene import describe
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

PACK_VERSION = 1
_MOST_SEEDS = 1_000_000
TILE_PX = 32
SIZE_PX = (640, 480)  # of a first-person picture, unless the page asks for another
PAGE_SINE = {"trig": 1}  # the option by which a first-person world computes as a page does
MODULES = ("packed_world.js", "episode_record.js", "world.js", "row.js")  # of the page, which play what is packed
_PAGE = Path(__file__).with_name("page")
_KINDS = (("Grid", GRID_WORLDS), ("BabyAI", BABYAI_WORLDS), ("First person", FIRST_PERSON_WORLDS))


@dataclass(frozen=True, slots=True)
class PackSummary:
    """The contents of a folder of packed worlds."""

    worlds: tuple[str, ...]
    skipped: tuple[str, ...]  # worlds whose rules are Python
    size_bytes: int


def pack_worlds(folder: Path, seeds: range, names: Collection[str] = ()) -> PackSummary:
    """Pack worlds into a folder, with their first states for the given seeds.

    Args:
        folder: the folder, which is created if necessary; files of an earlier pack in it are replaced.
        seeds: consecutive seeds, each 0 or more.
        names: the worlds' names, with or without ``minihuman/``; empty for all that a page can compute.

    Raises:
        WorldError: if there is no such world, or a named one has rules that a page cannot compute.
    """
    entries = _find_entries(names)
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    shutil.copytree(_PAGE / "worlds", folder / "worlds", dirs_exist_ok=True)
    for module in MODULES:
        shutil.copy(_PAGE / module, folder)
    packed: list[dict[str, Any]] = []
    skipped: list[str] = []
    for kind, entry in entries:
        options: dict[str, Any] = {}
        if kind == "First person":
            options = PAGE_SINE
        env = _make_world(entry, options)
        if not env.is_compiled:
            skipped.append(entry.name)
            continue
        if isinstance(env, FirstPersonEnv):
            starts = _write_scenes(folder, env, entry, seeds)
        else:
            starts = _write_rows(folder, env, entry, seeds)
        title = {"kind": kind, "title": f"{entry.name}: {entry.summary}", "name": entry.name, "options": options}
        seed_range = {"first_seed": seeds.start, "seeds": len(seeds)}
        packed.append(title | seed_range | {"actions": list(env.action_names)} | starts)
    if names and skipped:
        raise WorldError(f"{', '.join(skipped)}: the rules are Python, which no page computes; pack another world")
    index = {"version": PACK_VERSION, "atlas": _write_atlas(folder), "worlds": packed}
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8", newline="\n")
    size_bytes = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return PackSummary(tuple(world["name"] for world in packed), tuple(skipped), size_bytes)


def parse_seeds(text: str) -> range:
    """Parse seeds from the command line, such as "0-99" or a single number.

    Raises:
        WorldError: if the text is not a range of seeds, or the range has more than a million.
    """
    match = re.fullmatch(r"(\d{1,18})(?:-(\d{1,18}))?", text.strip())
    if match is None:
        raise WorldError(f"seeds {text!r} are no range; give the first and the last, such as 0-99")
    first_text, last_text = match.groups()
    first = int(first_text)
    last = int(last_text or first_text)
    count = last - first + 1
    if not 1 <= count <= _MOST_SEEDS:
        raise WorldError(f"seeds {text!r} are {count}; pack 1 to {_MOST_SEEDS}")
    return range(first, last + 1)


def _find_entries(names: Collection[str]) -> list[tuple[str, CatalogueEntry]]:
    """Return the named entries of the catalogue, or all if none is named, each with its kind of world."""
    entries = []
    for kind, of_kind in _KINDS:
        entries += [(kind, entry) for entry in of_kind]
    if not names:
        return entries
    chosen = {name.removeprefix("minihuman/") for name in names}
    unknown = chosen - {entry.name for _, entry in entries}
    if unknown:
        raise WorldError(f"{', '.join(sorted(unknown))}: no such world can be packed; `minihuman worlds` lists them")
    return [(kind, entry) for kind, entry in entries if entry.name in chosen]


def _make_world(entry: CatalogueEntry, options: dict[str, Any]) -> Any:
    """Make a world without the warning that a newer version exists, since all versions are packed."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        return gymnasium.make(entry.id, **options).unwrapped


def _write_rows(folder: Path, env: GridEngine, entry: CatalogueEntry, seeds: Sequence[int]) -> dict[str, Any]:
    """Pack a grid world's first states: the random states of all seeds, then the rows, then the missions."""
    rows = []
    words = []
    missions = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        state = env.save()
        rows.append(state.row)
        words.append(state.rng_state)
        missions.append(observation["mission"])
    distinct = missions
    if len(set(missions)) == 1:
        distinct = missions[:1]
    content = np.stack(words).tobytes() + np.stack(rows).tobytes() + json.dumps(distinct).encode()
    (folder / "starts" / f"{entry.name}.z").write_bytes(zlib.compress(content, 9))
    return {"row_length": len(rows[0]), "view_size": env.image_shape[0]}


class _ArrayPool:
    """Numbers distinct arrays and keeps each of them once."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self._numbers: dict[bytes, int] = {}

    def number(self, array: NDArray[Any]) -> int:
        """Return an array's number, adding the array if it is new."""
        content = array.tobytes()
        if content not in self._numbers:
            self._numbers[content] = len(self._numbers)
            self.kinds.append(str(array.dtype))
        return self._numbers[content]

    def extents(self) -> Iterator[tuple[str, int]]:
        """Yield the data type and the number of bytes of each array."""
        return zip(self.kinds, map(len, self._numbers), strict=True)

    def join(self) -> bytes:
        """Return the bytes of all arrays in order of their numbers."""
        return b"".join(self._numbers)


def _write_scenes(folder: Path, env: FirstPersonEnv, entry: CatalogueEntry, seeds: Sequence[int]) -> dict[str, Any]:
    """Pack a first-person world's first states and scenes: header length, header, each distinct array.

    The header is JSON. It gives the data type and bytes of each array and, for each seed, the numbers of its arrays by
    name, the number of things in its scene, and the names of its textures, which are files of their own.
    """
    pool = _ArrayPool()
    starts = []
    for seed in seeds:
        env.reset(seed=seed)
        state, scene, _ = describe(env, "classic", SIZE_PX)
        names = ("things", "numbers", "walls", "words", "rooms", "edges")
        of_state = {name: pool.number(np.asarray(array)) for name, array in zip(names, state, strict=False)}
        of_scene = {name: pool.number(array) for name, array in scene.tables.items()}
        textures = [_write_texture(folder / "textures", pixels.tobytes()) for pixels in scene.textures]
        mission = getattr(env, "mission", "") or entry.summary
        looks = {"looks": state.looks, "textures": textures, "mission": mission}
        starts.append({"state": of_state, "tables": of_scene} | looks)
    head = json.dumps({"arrays": list(pool.extents()), "starts": starts}).encode()
    content = len(head).to_bytes(4, "little") + head + pool.join()
    (folder / "starts" / f"{entry.name}.z").write_bytes(zlib.compress(content, 9))
    return {"size_px": SIZE_PX}


def _write_texture(folder: Path, pixels: bytes) -> str:
    """Write a texture under its digest, unless it exists already; return the digest."""
    name = hashlib.sha256(pixels).hexdigest()[:16]
    path = folder / f"{name}.z"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        path.write_bytes(zlib.compress(pixels, 9))
    return name


def _write_atlas(folder: Path) -> dict[str, Any]:
    """Pack the tiles; return the position of each of their arrays."""
    tile_atlas = atlas(TILE_PX, "classic")
    content = b""
    arrays: dict[str, Any] = {}
    for name in ("number", "under", "tiles", "agents", "carried"):
        array = getattr(tile_atlas, name)
        if name == "tiles":
            array = array.view(np.uint8)
        arrays[name] = {"at": len(content), "bytes": array.nbytes, "kind": str(array.dtype)}
        content += array.tobytes()
    (folder / "atlas.z").write_bytes(zlib.compress(content, 9))
    return {"tile_px": TILE_PX, "small_px": tile_atlas.carried.shape[1], "arrays": arrays}
