"""The table of levels: every BabyAI world of Minigrid, under its name, and where one errs by accident a repaired one."""

from typing import Any

from minihuman.worlds.entry import Entry

_MAKE = "minihuman.worlds.grid.env:make"
_MAKE_MANY = "minihuman.worlds.grid.batch:GridBatch"

FAITHFUL, REPAIRED = "v0", "v1"


def _level(name: str, family: str, summary: str, version: str = FAITHFUL, **options: Any) -> Entry:
    entry = Entry(
        f"BabyAI-{name}-{version}", _MAKE, {"family": family, **options}, _MAKE_MANY, summary, guards_itself=True
    )
    return entry


def _invented(name: str, summary: str, **options: Any) -> Entry:
    return _level(name, "level_gen", summary, **options)


_SYNTH = {"implicit_unlock": False}
_ONE = {"num_rows": 1, "num_cols": 1}
_SEQUENCES = {
    "GoToSeq": ("go to things, in order", {"action_kinds": ("goto",), "locked_room_prob": 0, "locations": False, "unblocking": False}),
}
