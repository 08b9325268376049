"""Packs worlds for pages without a server: compiled rules, tiles, textures, and how episodes begin.

Most grid worlds are laid out in the page, from any seed. Of the others the first states of some seeds are packed.

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
from minihuman.web.page_layouts import describe_language, describe_layout, find_layout_module, read_layout_modules
from minihuman.worlds.catalogue import BABYAI_WORLDS, FIRST_PERSON_WORLDS, GRID_WORLDS, CatalogueEntry
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.page_scene import describe
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas

if TYPE_CHECKING:
    from minihuman.worlds.grid.object_kinds import ObjectKind

PACK_VERSION = 2
_MOST_SEEDS = 1_000_000
_PAGE_SEEDS = 2**53  # the number of seeds that a page's numbers hold exactly
TILE_PX = 32
SIZE_PX = (640, 480)  # of a first-person picture, unless the page asks for another
PAGE_SINE = {"trig": 1}  # the option by which a first-person world computes as a page does
# the page's modules that play packed worlds
MODULES = ("packed_world.js", "layouts.js", "episode_record.js", "world.js", "row.js")
_PAGE = Path(__file__).with_name("page")
_KINDS = (("Grid", GRID_WORLDS), ("BabyAI", BABYAI_WORLDS), ("First person", FIRST_PERSON_WORLDS))


@dataclass(frozen=True, slots=True)
class PackSummary:
    """The contents of a folder of packed worlds."""

    worlds: tuple[str, ...]
    skipped: tuple[str, ...]  # worlds whose rules are Python
    packed_states: tuple[str, ...]  # worlds that have only the given seeds
    size_bytes: int


def pack_worlds(folder: Path, seeds: range, names: Collection[str] = ()) -> PackSummary:
    """Pack worlds into a folder.

    Args:
        folder: the folder, which is created if necessary; files of an earlier pack in it are replaced.
        seeds: consecutive seeds, each 0 or more, whose first states are packed of worlds that no page can lay out.
        names: the worlds' names, with or without ``minihuman/``; empty for all that a page can compute.

    Raises:
        WorldError: if there is no such world, a named one has rules that a page cannot compute, or the compiled layouts
            are of other sources.
    """
    entries = _find_entries(names)
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    for module in MODULES:
        shutil.copy(_PAGE / module, folder)
    writer = _PackWriter(folder, seeds)
    for kind, entry in entries:
        writer.add_world(kind, entry)
    if names and writer.skipped:
        skipped = ", ".join(writer.skipped)
        raise WorldError(f"{skipped}: the rules are Python, which no page computes; pack another world")
    writer.write_index()
    size_bytes = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    worlds = tuple(world["name"] for world in writer.worlds)
    packed_states = tuple(name for name in worlds if name not in writer.layouts)
    return PackSummary(worlds, tuple(writer.skipped), packed_states, size_bytes)


def pack_world(folder: Path, env: Any, seeds: Sequence[int], *, name: str, summary: str) -> None:
    """Pack one compiled world, which need not be in the catalogue, into a folder, where its seeds are numbered from 0.

    Args:
        folder: the folder, which is created if necessary.
        env: the world, unwrapped; a first-person world has the option `PAGE_SINE`.
        seeds: the seeds whose first states are packed, in any order.
        name: the name by which a page makes the world, which is also a file name.
        summary: the world's title, and its mission if it has none.

    Raises:
        WorldError: if the world is a first-person world without discrete actions, or the compiled layouts are of other
            sources.
    """
    (folder / "starts").mkdir(parents=True, exist_ok=True)
    writer = _PackWriter(folder, range(len(seeds)))
    writer.add_states(env, CatalogueEntry(name, "", summary=summary), seeds)
    writer.write_index()


class _PackWriter:
    """Writes worlds into a folder, then the index of the folder.

    Args:
        folder: the folder, which has a subfolder "starts".
        seeds: consecutive seeds whose first states ``add_world`` packs of worlds that no page can lay out.
    """

    def __init__(self, folder: Path, seeds: range) -> None:
        self.folder = folder
        self.seeds = seeds
        self.worlds: list[dict[str, Any]] = []
        self.skipped: list[str] = []
        self.layouts: dict[str, Any] = {}  # by name of the world, for worlds that pages lay out
        self._manifest = json.loads((_PAGE / "worlds/manifest.json").read_text(encoding="utf-8"))
        self._layout_modules = read_layout_modules()
        self._modules = {"grid"}  # names of the modules that the worlds need
        self._kinds: tuple[ObjectKind, ...] = ()  # object kinds that a world defines itself

    def add_world(self, kind: str, world: CatalogueEntry) -> None:
        """Write a world's first states, or record how a page lays it out; skip a world whose rules are Python.

        Args:
            kind: the heading under which the index lists the world, from ``_KINDS``.
            world: the world's entry in the catalogue.
        """
        options: dict[str, Any] = {}
        if kind == "First person":
            options = PAGE_SINE
        env = _make_world(world, options)
        if not env.is_compiled:
            self.skipped.append(world.name)
            return
        title = {"kind": kind, "title": f"{world.name}: {world.summary}", "name": world.name, "options": options}
        self.worlds.append(title | {"actions": list(env.action_names)} | self._write_starts(env, world))

    def add_states(self, env: Any, world: CatalogueEntry, seeds: Sequence[int]) -> None:
        """Write the first states of a world for some seeds, which are numbered from 0."""
        if isinstance(env, FirstPersonEnv):
            self._modules.add("first_person")
            starts = _write_scenes(self.folder, env, world, seeds)
        else:
            self._kinds = env.kinds
            starts = _write_rows(self.folder, env, world, seeds)
        title = {"kind": "", "title": world.summary, "name": world.name, "options": {}}
        packed_seeds = {"first_seed": 0, "seeds": len(seeds)}
        self.worlds.append(title | packed_seeds | {"actions": list(env.action_names)} | starts)

    def _write_starts(self, env: Any, world: CatalogueEntry) -> dict[str, Any]:
        """Write a world's first states, or record its layout; return the fields for the index."""
        packed_seeds = {"first_seed": self.seeds.start, "seeds": len(self.seeds)}
        if isinstance(env, FirstPersonEnv):
            self._modules.add("first_person")
            return packed_seeds | _write_scenes(self.folder, env, world, self.seeds)
        layout_module = find_layout_module(env, self._layout_modules)
        if layout_module is None:
            return packed_seeds | _write_rows(self.folder, env, world, self.seeds)
        self._modules.add(layout_module)
        self.layouts[world.name] = describe_layout(env)
        return {"first_seed": 0, "seeds": _PAGE_SEEDS, "layouts": layout_module} | _describe_sizes(env)

    def write_index(self) -> None:
        """Write the modules, the tiles, the descriptions of layouts, and the index, all of them compressed."""
        modules = self._manifest["modules"] | self._layout_modules
        needed = {name: modules[name] for name in sorted(self._modules)}
        (self.folder / "worlds").mkdir(exist_ok=True)
        for module in needed.values():
            for file in module["files"]:
                file_name = file["file"]
                _write_deflated(self.folder / f"worlds/{file_name}.z", (_PAGE / "worlds" / file_name).read_bytes())
        if self.layouts:
            _write_deflated(self.folder / "layouts.z", {"worlds": self.layouts, "language": describe_language()})
        manifest = {"sources": self._manifest["sources"], "modules": needed}
        index = {"version": PACK_VERSION, "atlas": _write_atlas(self.folder, self._kinds), "manifest": manifest}
        _write_deflated(self.folder / "index.z", index | {"worlds": self.worlds})


def _write_deflated(path: Path, content: bytes | dict[str, Any]) -> None:
    """Write bytes, or an object as JSON, in compressed form."""
    if isinstance(content, dict):
        content = json.dumps(content, separators=(",", ":")).encode()
    path.write_bytes(zlib.compress(content, 9))  # as small as possible


def _describe_sizes(env: GridEngine) -> dict[str, Any]:
    return {"row_length": len(env.state.row), "view_size": env.image_shape[0]}


def parse_seeds(text: str) -> range:
    """Parse seeds from the command line, such as "0-99" or a single number.

    Raises:
        WorldError: if the text is not a range of seeds, or the range is empty or has more than a million.
    """
    match = re.fullmatch(r"(\d{1,18})(?:-(\d{1,18}))?", text.strip())
    if match is None:
        raise WorldError(f"seeds {text!r} are no range; give the first and the last, such as 0-99")
    first_text, last_text = match.groups()
    first = int(first_text)
    last = int(last_text or first_text)
    count = last - first + 1
    if not 1 <= count <= _MOST_SEEDS:
        raise WorldError(f"seeds {text!r} are {max(count, 0)} seeds; pack 1 to {_MOST_SEEDS}")
    return range(first, last + 1)


def _find_entries(names: Collection[str]) -> list[tuple[str, CatalogueEntry]]:
    """Return the named entries of the catalogue, or all if none is named, each with its kind of world.

    Raises:
        WorldError: if there is no entry of a name.
    """
    entries = []
    for kind, entries_of_kind in _KINDS:
        entries += [(kind, entry) for entry in entries_of_kind]
    if not names:
        return entries
    requested = {name.removeprefix("minihuman/") for name in names}
    unknown = requested - {entry.name for _, entry in entries}
    if unknown:
        raise WorldError(f"{', '.join(sorted(unknown))}: no such world can be packed; `minihuman worlds` lists them")
    return [(kind, entry) for kind, entry in entries if entry.name in requested]


def _make_world(entry: CatalogueEntry, options: dict[str, Any]) -> Any:
    """Make a world without the warning that a newer version exists, since all versions are packed."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*is out of date", DeprecationWarning)
        return gymnasium.make(entry.id, **options).unwrapped


def _write_rows(folder: Path, env: GridEngine, entry: CatalogueEntry, seeds: Sequence[int]) -> dict[str, Any]:
    """Write a file of a grid world's first states: the random states of all seeds, then the rows, then the missions.

    Returns:
        The fields for the index.
    """
    rows = []
    rng_states = []
    missions = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        state = env.save()
        rows.append(state.row)
        rng_states.append(state.rng_state)
        missions.append(observation["mission"])
    if len(set(missions)) == 1:
        missions = missions[:1]  # one for all seeds
    content = np.stack(rng_states).tobytes() + np.stack(rows).tobytes() + json.dumps(missions).encode()
    _write_deflated(folder / "starts" / f"{entry.name}.z", content)
    return _describe_sizes(env)


class _ArrayPool:
    """Numbers distinct arrays and keeps each of them once."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, bytes], int] = {}  # by data type and content

    def number(self, array: NDArray[Any]) -> int:
        """Return an array's number, adding the array if it is new."""
        return self._numbers.setdefault((str(array.dtype), array.tobytes()), len(self._numbers))

    def extents(self) -> Iterator[tuple[str, int]]:
        """Yield the data type and the number of bytes of each array, in order of their numbers."""
        return ((kind, len(content)) for kind, content in self._numbers)

    def join(self) -> bytes:
        """Return the bytes of all arrays in order of their numbers."""
        return b"".join(content for _, content in self._numbers)


def _write_scenes(folder: Path, env: FirstPersonEnv, entry: CatalogueEntry, seeds: Sequence[int]) -> dict[str, Any]:
    """Write a file of a first-person world's first states and scenes: header length, header, each distinct array.

    The header is JSON. It gives the data type and bytes of each array and, for each seed, the numbers of its arrays by
    name, the number of things in its scene, and the names of its textures, which are separate files.

    Returns:
        The fields for the index.

    Raises:
        WorldError: if the world does not have discrete actions.
    """
    if env.control != "discrete":
        raise WorldError(
            f"{entry.name} has control = {env.control!r}; pack it with 'discrete', which packed worlds have"
        )
    pool = _ArrayPool()
    starts = []
    for seed in seeds:
        env.reset(seed=seed)
        state, scene, _ = describe(env, "classic", SIZE_PX)
        names = ("things", "numbers", "walls", "words", "rooms", "edges")
        state_arrays = {name: pool.number(np.asarray(array)) for name, array in zip(names, state, strict=False)}
        scene_tables = {name: pool.number(array) for name, array in scene.tables.items()}
        textures = [_write_texture(folder / "textures", pixels.tobytes()) for pixels in scene.textures]
        mission = getattr(env, "mission", "") or entry.summary
        looks = {"looks": state.looks, "textures": textures, "mission": mission}
        starts.append({"state": state_arrays, "tables": scene_tables} | looks)
    head = json.dumps({"arrays": list(pool.extents()), "starts": starts}).encode()
    content = len(head).to_bytes(4, "little") + head + pool.join()
    _write_deflated(folder / "starts" / f"{entry.name}.z", content)
    return {"size_px": SIZE_PX}


def _write_texture(folder: Path, pixels: bytes) -> str:
    """Write a texture under its digest, unless it exists already; return the digest."""
    name = hashlib.sha256(pixels).hexdigest()[:16]
    path = folder / f"{name}.z"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        _write_deflated(path, pixels)
    return name


def _write_atlas(folder: Path, kinds: "tuple[ObjectKind, ...]") -> dict[str, Any]:
    """Write a file of the tiles' arrays, including the tiles of additional object kinds.

    Returns:
        The tiles' sizes in pixels and, by array, its position and size in bytes in the file, and its data type.
    """
    tile_atlas = atlas(TILE_PX, "classic", kinds)
    content = b""
    arrays: dict[str, Any] = {}
    for name in ("number", "under", "tiles", "agents", "carried"):
        array = getattr(tile_atlas, name)
        if name == "tiles":
            array = array.view(np.uint8)
        arrays[name] = {"at": len(content), "bytes": array.nbytes, "kind": str(array.dtype)}
        content += array.tobytes()
    _write_deflated(folder / "atlas.z", content)
    return {"tile_px": TILE_PX, "small_px": tile_atlas.carried.shape[1], "arrays": arrays}
