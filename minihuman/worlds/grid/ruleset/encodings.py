"""Goals and rules as observations have them: XLand-MiniGrid's numbers, of many states at once."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.ruleset.dynamics import (
    GOAL,
    GOAL_AGENT_AT,
    GOAL_TILE_AT,
    GOAL_TILE_NEAR,
    GOAL_TILE_NEAR_LEFT,
    GOAL_TILE_NEAR_UP,
    HEADER,
    PER_RULE,
    TILE_NEAR,
    TILE_NEAR_LEFT,
    Row,
)


def encode_tasks(rows: Row, most_rules: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the goals and rules of states as XLand-MiniGrid encodes them.

    Args:
        rows: the states, int32[n, row].
        most_rules: the number of rules that a row has space for.

    Returns:
        The goals, uint8[n, 5], and the rules, uint8[n, most_rules, 7]; what is not used is 0.
    """
    rules = rows[:, HEADER : HEADER + PER_RULE * most_rules].reshape(-1, most_rules, PER_RULE).astype(np.uint8)
    kinds, first, second, product = (rules[..., part] for part in range(PER_RULE))
    is_pair = (kinds >= TILE_NEAR) & (kinds <= TILE_NEAR_LEFT)
    tiles = [first, np.where(is_pair, second, product), np.where(is_pair, product, 0)]
    encoded_rules = np.stack([kinds, *(part for tile in tiles for part in (tile & 15, tile >> 4))], axis=-1)
    return _encode_goals(rows[:, GOAL : GOAL + 4].astype(np.uint8)), encoded_rules.astype(np.uint8)


def _encode_goals(goals: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return goals, uint8[n, 4], as uint8[n, 5]: each tile becomes a kind and a colour, and a cell stays."""
    kinds, first, second, third = goals.T
    is_pair = (kinds == GOAL_TILE_NEAR) | ((kinds >= GOAL_TILE_NEAR_UP) & (kinds <= GOAL_TILE_NEAR_LEFT))
    is_place = kinds == GOAL_AGENT_AT
    is_tile_at = kinds == GOAL_TILE_AT
    return np.stack(
        [
            kinds,
            np.where(is_place, first, first & 15),
            np.where(is_place, second, first >> 4),
            np.where(is_tile_at, second, np.where(is_pair, second & 15, 0)),
            np.where(is_tile_at, third, np.where(is_pair, second >> 4, 0)),
        ],
        axis=-1,
    ).astype(np.uint8)
