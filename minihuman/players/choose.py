"""Which player: the installed ones, by name. Others register in the entry-point group ``minihuman.players``."""

from importlib.metadata import entry_points

import numpy as np

from minihuman.errors import PlayerError
from minihuman.players.port import Player

GROUP = "minihuman.players"


def make_player(name: str, rng: np.random.Generator) -> Player:
    """Make a player from its name; what follows a colon is the player's own ("human-like:lapse=0.1").

    Raises:
        PlayerError: if no player has that name, or its own part is wrong.
    """
    kind, _, argument = name.partition(":")
    found = entry_points(group=GROUP, name=kind)
    if not found:
        known = ", ".join(sorted(entry.name for entry in entry_points(group=GROUP)))
        raise PlayerError(f"player {kind!r} is unknown; it is one of {known}")
    (entry, *_) = found
    player = entry.load()(argument, rng)
    assert isinstance(player, Player), f"{entry.value} is no minihuman.players.port.Player"
    return player
