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
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.catalogue import BABYAI_WORLDS, FIRST_PERSON_WORLDS, GRID_WORLDS, CatalogueEntry
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.page_scene import describe
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

if TYPE_CHECKING:
    from minihuman.worlds.grid.object_kinds import ObjectKind

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
        starts = _write_starts(folder, env, entry, seeds)
        title = {"kind": kind, "title": f"{entry.name}: {entry.summary}", "name": entry.name, "options": options}
        seed_range = {"first_seed": seeds.start, "seeds": len(seeds)}
        packed.append(title | seed_range | {"actions": list(env.action_names)} | starts)
    if names and skipped:
        raise WorldError(f"{', '.join(skipped)}: the rules are Python, which no page computes; pack another world")
    _write_index(folder, _write_atlas(folder), packed)
    size_bytes = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return PackSummary(tuple(world["name"] for world in packed), tuple(skipped), size_bytes)


def pack_world(folder: Path, env: Any, seeds: Sequence[int], *, name: str, summary: str) -> None:
    """Pack one compiled world, which need not be of the catalogue, into a folder; seeds are numbered from 0 in it.

    Args:
        folder: the folder, which is created if necessary.
        env: the world, unwrapped; a first-person world has the option `PAGE_SINE`.
        seeds: the seeds whose first states are packed, in any order.
        name: the name by which a page makes the world; a file has it.
        summary: the mission of a world that has none.
    """
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    shutil.copytree(_PAGE / "worlds", folder / "worlds", dirs_exist_ok=True)
    starts = _write_starts(folder, env, CatalogueEntry(name, "", summary=summary), seeds)
    kinds: tuple[ObjectKind, ...] = ()
    if isinstance(env, GridEngine):
        kinds = env.kinds
    description = {"kind": "", "title": summary, "name": name, "options": {}, "first_seed": 0, "seeds": len(seeds)}
    _write_index(folder, _write_atlas(folder, kinds), [description | {"actions": list(env.action_names)} | starts])


def _write_starts(folder: Path, env: Any, catalogued: CatalogueEntry, seeds: Sequence[int]) -> dict[str, Any]:
    if isinstance(env, FirstPersonEnv):
        return _write_scenes(folder, env, catalogued, seeds)
    return _write_rows(folder, env, catalogued, seeds)


def _write_index(folder: Path, tiles: dict[str, Any], packed: Sequence[dict[str, Any]]) -> None:
    index = {"version": PACK_VERSION, "atlas": tiles, "worlds": packed}
    (folder / "index.json").write_text(json.dumps(index), encoding="utf-8", newline="\n")


def parse_seeds(text: str) -> range:
    """Parse seeds from the command line, such as "0-99" or a single number.

    Raises:
        WorldError: if the text is not a range of seeds, or the range has more than a million.
    """
    match = re.fullmatch(r"(\d{1,18})(?:-(\d{1,18}))?", text.strip())
    if match is None:
        raise WorldError(f"seeds {text!r} are no range; give the first and the last, such as 0-99")
    first = int(match[1])
    last = int(match[2] or match[1])
    if not 0 <= last - first < _MOST_SEEDS:
        raise WorldError(f"seeds {text!r} are {last - first + 1}; pack 1 to {_MOST_SEEDS}")
    return range(first, last + 1)


def _find_entries(names: Collection[str]) -> list[tuple[str, CatalogueEntry]]:
    every = [(kind, entry) for kind, entries in _KINDS for entry in entries]
    chosen = {name.removeprefix("minihuman/") for name in names}
    if unknown := chosen - {entry.name for _, entry in every}:
        raise WorldError(f"{', '.join(sorted(unknown))}: no such world can be packed; `minihuman worlds` lists them")
    return [(kind, entry) for kind, entry in every if not chosen or entry.name in chosen]


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


def _write_atlas(folder: Path, kinds: "tuple[ObjectKind, ...]" = ()) -> dict[str, Any]:
    """Pack the tiles, with those of a world's own object kinds; return the position of each of their arrays."""
    tile_atlas = atlas(TILE_PX, "classic", kinds)
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
