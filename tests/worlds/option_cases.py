"""Worlds with options nobody foresaw, tried in processes of their own: what becomes of each."""

import inspect
import json
import math
import queue
import subprocess
import sys
import threading
from contextlib import suppress
from typing import Any

from minihuman.worlds.catalogue import WORLDS
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.parameters import DEFAULTS
from minihuman.worlds.grid.babyai.levels import LEVELS
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.env import FAMILIES, GridEnv
from minihuman.worlds.grid.layouts.go_to_obj import GoToObjGrid

LIMIT_S = 60.0  # for one case, on a machine that others use too

EDGES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        -1,
        0,
        1,
        2,
        3,
        4,
        5,
        6,
        7,
        8,
        9,
        12,
        19,
        40,
        99,
        101,
        1023,
        1024,
        1025,
        100_000,
        2**31,
        2**63,
    ),
    *(10**12, -(10**9), -3.0, 0.0, 1e-9, 0.5, 2.5, 8.0, 60.0, 1e9, 1e300, math.nan, math.inf, -math.inf),
    *("", "pink", "lava", "wall", "door", "key", "banana", "classic", "colour-safe", "agent", "top", "rgb_array"),
    *([], [1], [3], [1, 1], [0, 0], [-3, 4], [1, 2, 3], [2, 2.5], [100, 100], [100_000_000, 3], [50, 3], [18, 18]),
    *([math.nan, 0, 0], [1e9, 0, 0], [10, 0, -6], ["a", "b"], ["move_forward"], {}, {"x": 1}),
    *({"forward_step": 1e-9}, {"forward_step": 1e9}, {"turn_step": math.nan}, {"cam_fov_y": 0}, {"cam_fov_y": 180.0}),
    *({"sky_color": [0.1, 0.2, 0.3]}, {"sky_color": 0.5}, {"bot_radius": -1}, {"cam_pitch": 90.0}, {"nothing": 1}),
)
LEVEL_EDGES: tuple[Any, ...] = (  # where words are chosen from
    *(
        "goto",
        "loc",
        "color",
        "go to the red ball",
        "go to the red ball, then open a door",
        ["goto"],
        ["pickup", "open"],
    ),
    *(["putnext"], ["goto", "nothing"], ["action"], ["and", "seq"], ["seq", 3], [["goto"]], 0.25, 1.5, -0.1),
)
NOT_OPTIONS = {"family", "layout", "render_mode", "self", "options", "mission", "kinds"}
# where what all worlds of a kind take is tried
GENERAL = "minihuman/MiniGrid-Empty-5x5-v0", "minihuman/MiniWorld-OneRoom-v0", "minihuman/BabyAI-GoToSeq-v0"
Case = tuple[str, dict[str, Any]]


def options_of(world_id: str, *, general: bool = True) -> list[str]:
    """Every option that a world takes; without those that all take."""
    (entry,) = (each for each in WORLDS if each.id == world_id)
    grid = "MiniGrid" in world_id
    if level := LEVELS.get(entry.kwargs.get("family")):
        free = level.sizes.keys() - set(level.fixed) | _names(level.trace)
        return sorted(free - {"builder"} | (_names(type(level).__call__) | {"mission"} if general else set()))
    if "layout" in entry.kwargs:
        own: list[Any] = list(_class(entry.kwargs["layout"]).__mro__)
        own = own[: own.index(FirstPersonEnv)]
    else:
        own = [FAMILIES[entry.kwargs["family"]] if "family" in entry.kwargs else GoToObjGrid]
    names = _names(*own)
    if general and grid:
        names |= _names(GridEnv, GridEngine) - {"width", "height", "actions"} | {"view", "obs_width", "obs_height"}
    elif general:
        names |= _names(FirstPersonEnv)
    return sorted(names)


def _names(*makers: Any) -> set[str]:
    return {name for maker in makers for name in inspect.signature(maker).parameters} - NOT_OPTIONS


def one_world_a_kind() -> list[str]:
    """One id for each family, each level and each class of 3D world."""
    found: dict[str, str] = {}
    for entry in WORLDS:
        found.setdefault(str(entry.kwargs.get("family", entry.kwargs.get("layout", entry.id))), entry.id)
    return list(found.values())


def edge_cases() -> list[Case]:
    """Every option of every kind of world, alone, at every edge; what all of a kind take in one of them."""
    tried = [(world, name) for world in one_world_a_kind() for name in options_of(world, general=world in GENERAL)]
    edges = {True: EDGES + LEVEL_EDGES, False: EDGES}
    return [(world, {name: value}) for world, name in tried for value in edges["BabyAI" in world]]


class Trials:
    """A process that tries cases; where one ends it or takes too long, that is its outcome, and another begins."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Trials":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop()

    def outcome(self, case: Case) -> str:
        """ "refused: ...", "played", or what went wrong: "broken: ...", "signal ...", "no end"."""
        if self._process is None:
            self._begin()
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(case) + "\n")
        self._process.stdin.flush()
        try:
            said = self._said.get(timeout=LIMIT_S)
        except queue.Empty:
            self._stop()
            return "no end"
        if said is None:
            code = self._process.wait()
            self._stop()
            return f"signal {-code}" if code < 0 else f"exit {code}"
        return said

    def _begin(self) -> None:
        command = [sys.executable, "-m", "tests.worlds.option_trial"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._said: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=self._listen, args=(self._process, self._said), daemon=True).start()

    @staticmethod
    def _listen(process: "subprocess.Popen[str]", said: "queue.Queue[str | None]") -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said.put(line.strip())
        said.put(None)

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                with suppress(BrokenPipeError):
                    pipe.close()
            self._process = None


def _class(layout: str) -> Any:
    from importlib import import_module

    module, _, name = layout.partition(":")
    return getattr(import_module(f"minihuman.worlds.first_person.{module}"), name)


PARAMETERS = sorted(DEFAULTS._table)
