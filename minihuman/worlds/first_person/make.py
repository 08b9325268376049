"""How Gymnasium makes the worlds of the catalogue, one or many."""

from importlib import import_module
from typing import Any

from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.vector import FirstPersonBatch

_BATCH_SETTINGS = frozenset({"num_envs", "autoreset_mode", "threads"})


def make(layout: str, **options: Any) -> FirstPersonEnv:
    """The world that a module of this package describes: ``make("layouts.mazes:Maze", num_rows=3)``."""
    module, _, name = layout.partition(":")
    world: FirstPersonEnv = getattr(import_module(f"minihuman.worlds.first_person.{module}"), name)(**options)
    return world


def make_many(layout: str, **options: Any) -> FirstPersonBatch:
    """A batch of such worlds, for ``gymnasium.make_vec``."""
    settings = {name: options.pop(name) for name in _BATCH_SETTINGS & options.keys()}
    return FirstPersonBatch(lambda: make(layout, **options), **settings)


vars(make)["metadata"] = FirstPersonEnv.metadata  # where Gymnasium looks which render modes it has to add
