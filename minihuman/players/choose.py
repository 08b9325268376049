"""Which player: the installed ones, by name. Others register in the entry-point group ``minihuman.players``."""

import numpy as np

from minihuman.errors import PlayerError
from minihuman.players.port import Player
from minihuman.plugins import check_made, load

GROUP = "minihuman.players"


def make_player(name: str, rng: np.random.Generator) -> Player:
    """Make a player from its name; what follows a colon is the player's own ("human-like:lapse=0.1").

    Raises:
        PlayerError: if no player has that name, or its own part is wrong.
    """
    kind, _, argument = name.partition(":")
    player = load(GROUP, kind, PlayerError, what="player")(argument, rng)
    check_made(player, Player, PlayerError, group=GROUP, name=kind)
    assert isinstance(player, Player)  # checked just now
    return player
