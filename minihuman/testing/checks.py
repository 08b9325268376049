"""The error for a broken contract, and the short study in which participants and exporters are tested."""

from contextlib import closing
from typing import Any

import msgspec

from minihuman.errors import MinihumanError
from minihuman.experiment.keys import DIGITS
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.worlds.adapters.world import World


class ContractError(MinihumanError, AssertionError):
    """A plug-in breaks a guarantee of its kind."""

    exit_code = 1  # a check failed


def require(is_kept: bool, broken: str) -> None:
    """Raise a `ContractError` with the message ``broken`` unless the guarantee is kept."""
    if not is_kept:
        raise ContractError(broken)


def build_short_study(world_id: str, options: dict[str, Any], *, episodes: int, max_steps: int) -> Protocol:
    """Return a protocol of one block in a world, with every action of the world on a digit key.

    Raises:
        ContractError: if the world has more actions than there are digit keys.
    """
    with closing(World(world_id, options, trusted=True)) as world:
        actions = world.action_names
    require(len(actions) <= len(DIGITS), f"{world_id}: {len(actions)} actions; a check has {len(DIGITS)} keys to give")
    block = {
        "name": "block",
        "world": world_id,
        "options": options,
        "episodes": episodes,
        "actions": actions,
        "max_steps": max_steps,
        "key_map": "new",
    }
    return build_study(
        {
            "study": {"name": "contract", "version": "1", "seed": 5, "participants": 8},
            "keys": {"pool": DIGITS[: len(actions)]},
            "groups": [{"name": "everyone", "blocks": ["block"]}],
            "blocks": [block],
        }
    )


def build_study(tables: dict[str, Any]) -> Protocol:
    """Return the protocol that has the given tables of a TOML file, by name; a list stands for an array of tables.

    Raises:
        ProtocolError: if the protocol is invalid.
    """
    text = "".join(f"{name} = {_format_toml(table)}\n" for name, table in tables.items())
    return decode_protocol(text.encode(), "the study of a check")


def _format_toml(value: Any) -> str:
    """Return a table, list, text, number or boolean as TOML on one line."""
    match value:
        case dict():
            return "{ " + ", ".join(f"{name} = {_format_toml(field)}" for name, field in value.items()) + " }"
        case list() | tuple():
            return f"[{', '.join(map(_format_toml, value))}]"
    return msgspec.json.encode(value).decode()
