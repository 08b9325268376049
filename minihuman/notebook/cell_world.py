"""A world for a notebook's cell: its rules, first states and pictures as one block of bytes, and the keys to play it.

The cell plays by the page's own modules; it fetches nothing, as a notebook may be far from this process's files.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium

from minihuman.errors import WorldError
from minihuman.web.key_codes import KEY_CODES
from minihuman.web.page_data.page_episodes import name_key
from minihuman.web.world_pack import PAGE_SINE, pack_world
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.registration import register_with_gymnasium as _register

_PAGE = Path(__file__).parents[1] / "web" / "page"
# in the order of their imports
_MODULES = ("row.js", "world.js", "layouts.js", "packed_world.js", "episode_record.js", "episode_view.js")
_PACKED_NAME = "world"
_USUAL_KEYS: Mapping[str, str] = {
    "left": "ArrowLeft",
    "turn_left": "ArrowLeft",
    "right": "ArrowRight",
    "turn_right": "ArrowRight",
    "forward": "ArrowUp",
    "move_forward": "ArrowUp",
    "move_back": "ArrowDown",
    "toggle": " ",
    "pickup": "p",
    "drop": "d",
}
_OTHER_KEYS = "123456789abcefghijklmnoqrstuvwxyz"  # of other actions, in order


@dataclass(frozen=True, slots=True)
class CellWorld:
    """A world to play in a cell.

    Attributes:
        id: the Gymnasium id.
        options: the keyword arguments of ``gymnasium.make``.
        seeds: the seeds of the episodes, in order.
        view: "partial" for what the agent sees, or "full".
        keys: the action of each key, by `KeyboardEvent.key`.
        pack: the files of the packed world.
    """

    id: str
    options: dict[str, Any]
    seeds: tuple[int, ...]
    view: str
    keys: dict[str, str]
    pack: bytes


def pack_cell_world(
    world: str,
    seeds: Sequence[int],
    *,
    view: str = "partial",
    keys: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
) -> CellWorld:
    """Pack a world for a cell: its rules, first states and pictures, with the keys that play it.

    Args:
        world: a Gymnasium id; the prefix ``minihuman/`` is optional.
        seeds: the seeds of the episodes, in order.
        view: "partial" for what the agent sees, or "full" for all of a grid.
        keys: the action of each key, by `KeyboardEvent.key`; None for the usual keys.
        options: the keyword arguments of ``gymnasium.make``.

    Raises:
        WorldError: if there is no such world, another argument is not valid, or no page can compute the world.
    """
    world_id = world
    if "/" not in world and ":" not in world:
        world_id = f"minihuman/{world}"
    world_options = dict(options or {})
    env = _make_world(world_id, world_options)
    if isinstance(env, FirstPersonEnv) and not env.trig:
        world_options |= PAGE_SINE
        env = _make_world(world_id, world_options)
    _require_computable(env, world_id, view)
    if not seeds or min(seeds) < 0:
        raise WorldError(f"seeds are {list(seeds)}; give one or more, each 0 or more")
    if keys is None:
        keys = choose_keys(env.action_names)
    key_map = dict(keys)
    _check_keys(key_map, env, world_id)
    with tempfile.TemporaryDirectory() as folder:
        pack_world(Path(folder), env, seeds, name=_PACKED_NAME, summary=world_id.rpartition("/")[2])
        pack = _join_files(Path(folder))
    env.close()
    return CellWorld(world_id, world_options, tuple(seeds), view, key_map, pack)


def _make_world(world_id: str, options: dict[str, Any]) -> Any:
    """Make a world without Gymnasium's wrappers; raise `WorldError` if Gymnasium cannot make it."""
    _register()
    try:
        return gymnasium.make(world_id, disable_env_checker=True, **options).unwrapped
    except gymnasium.error.Error as error:
        raise WorldError(f"{world_id}: {error}") from error


def _require_computable(env: Any, world_id: str, view: str) -> None:
    """Raise `WorldError` unless a page can compute a world's steps and pictures in a view."""
    if not isinstance(env, GridEngine | FirstPersonEnv) or not env.is_compiled:
        raise WorldError(
            f"{world_id}: its rules or pictures are not compiled, so no page computes it; play it with: minihuman play"
        )
    if view not in ("partial", "full"):
        raise WorldError(f"view is {view!r}; it is 'partial' or 'full'")
    if view == "full" and isinstance(env, FirstPersonEnv):
        raise WorldError(f"{world_id}: a page draws a first-person world by what the agent sees; remove view='full'")


def choose_keys(actions: Sequence[str]) -> dict[str, str]:
    """Return the action of each key: an action's usual key if it has one that is free, or else the next spare key."""
    keys: dict[str, str] = {}
    spare_keys = iter(_OTHER_KEYS)
    for action in actions:
        key = _USUAL_KEYS.get(action, "")
        if not key or key in keys:
            key = next(spare_keys)
        keys[key] = action
    return keys


def _check_keys(keys: dict[str, str], env: Any, world_id: str) -> None:
    """Raise `WorldError` unless every key can be logged and has an action of the world."""
    for key, action in keys.items():
        if action not in env.action_names:
            raise WorldError(f"key {key!r} has action {action!r}; {world_id} has {', '.join(env.action_names)}")
        if not name_key(key):
            raise WorldError(
                f"key {key!r} is none that a log can hold; use a letter, a digit or one of {', '.join(KEY_CODES)}"
            )


def _join_files(folder: Path) -> bytes:
    """Join a folder's files into one block of bytes.

    It begins with the header's length (4 bytes, little-endian) and the header, a JSON list with each file's path and
    size; the files follow in this order.
    """
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    contents = [path.read_bytes() for path in paths]
    extents = [
        (path.relative_to(folder).as_posix(), len(content)) for path, content in zip(paths, contents, strict=True)
    ]
    header = json.dumps(extents).encode()
    return len(header).to_bytes(4, "little") + header + b"".join(contents)


def read_modules() -> list[tuple[str, str]]:
    """Return the name and text of each of the page's modules that a cell runs, in the order of their imports."""
    return [(name, (_PAGE / name).read_text(encoding="utf-8")) for name in _MODULES]
