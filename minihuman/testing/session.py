"""The study that players and exporters are tried in: a few short episodes of one world."""

from typing import Any

from minihuman.study.keys import DIGITS
from minihuman.study.protocol import Protocol, decode
from minihuman.testing.kept import promise
from minihuman.worlds.adapt.world import World

_TOML = """
[study]
name = "contract"
version = "1"
seed = 5
participants = 8

[keys]
pool = [{pool}]

[[groups]]
name = "everyone"
blocks = ["block"]

[[blocks]]
name = "block"
world = "{world}"
options = {{ {options} }}
episodes = {episodes}
actions = [{actions}]
max_steps = {max_steps}
key_map = "fresh"
"""


def short_study(world_id: str, options: dict[str, Any], *, episodes: int, max_steps: int) -> Protocol:
    """A protocol of one block, with every action of the world on a digit key."""
    world = World(world_id, options)
    actions = world.action_names
    world.close()
    promise(len(actions) <= len(DIGITS), f"{world_id}: {len(actions)} actions; a check has {len(DIGITS)} keys to give")
    given = ", ".join(f"{name} = {_value(value)}" for name, value in options.items())
    text = _TOML.format(
        pool=_list(tuple(DIGITS)[: len(actions)]),
        world=world_id,
        options=given,
        episodes=episodes,
        actions=_list(actions),
        max_steps=max_steps,
    )
    return decode(text.encode(), "the study of a check")


def _list(names: tuple[str, ...]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def _value(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool | int | float) else f'"{value}"'
