"""Keys: when each one's action is discovered, and what is pressed in vain.

A step has a visible effect if the observation after it differs from the one before it.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from minihuman.log.episode import Episode


@dataclass(frozen=True, slots=True)
class KeyUse:
    """One key under one key map: how it was used, and when what it does first showed.

    ``found_s`` is playing time in episodes, and ``found_steps`` the steps done up to and with that press, since the key
    map came into force; both None while its action never showed.
    """

    key: str
    action: str | None  # None: no action
    first_episode: int  # the key map's first, by EpisodePlan.episode
    presses: int  # all that went down while an episode ran, auto-repeats left out
    steps: int  # that stepped the world
    in_vain: int  # steps without a visible effect
    refused: int  # presses with no action, or while no action was taken
    found_s: float | None
    found_steps: int | None


def visible_effect(episode: Episode) -> NDArray[np.bool_]:
    """Whether each step changed what is seen, (n,)."""
    return np.not_equal(episode.observation_hashes[1:], episode.observation_hashes[:-1])


def key_uses(episodes: Sequence[Episode]) -> tuple[KeyUse, ...]:
    """How every key was used, one row for each key of each key map, and for each other key that was tried."""
    rows: list[KeyUse] = []
    for key_map, run in groupby(episodes, key=lambda episode: episode.plan.key_map):
        under = list(run)
        tallies = _tally(under)
        others = {*key_map.spare_keys, *tallies} - {*key_map.keys, ""}  # "" caused a tick's no-op
        for key in (*sorted(key_map.keys), *sorted(others)):
            tally, action = tallies.get(key, _Tally()), key_map.keys.get(key)
            found_s, found_steps = tally.found if tally.found and action is not None else (None, None)
            rows.append(
                KeyUse(
                    key=key,
                    action=action,
                    first_episode=under[0].plan.episode,
                    presses=tally.presses,
                    steps=tally.steps,
                    in_vain=tally.in_vain,
                    refused=tally.refused,
                    found_s=found_s,
                    found_steps=found_steps,
                )
            )
    return tuple(rows)


def refused_presses(episode: Episode) -> int:
    """How many presses in an episode had no action, or came while none was taken; auto-repeats left out."""
    return sum(press.down and press.verdict not in ("accepted", "queued", "repeat") for press in episode.keys)


@dataclass(slots=True)
class _Tally:
    presses: int = 0
    refused: int = 0
    steps: int = 0
    in_vain: int = 0
    found: tuple[float, int] | None = None


def _tally(under: Sequence[Episode]) -> dict[str, _Tally]:
    """Count every key's presses and steps under one key map, in one pass."""
    tallies: dict[str, _Tally] = defaultdict(_Tally)
    done = played_ns = 0
    for episode in under:
        for press in episode.keys:
            if press.down and press.verdict != "repeat":
                tallies[press.key].presses += 1
                tallies[press.key].refused += press.verdict not in ("accepted", "queued")
        for step, (cause, shows) in enumerate(zip(episode.step_keys, visible_effect(episode).tolist(), strict=True)):
            tally = tallies[cause]
            tally.steps += 1
            tally.in_vain += not shows
            if shows and tally.found is None:
                since_ns = played_ns + int(episode.key_t_ns[step] - episode.t_ns[0])
                tally.found = (since_ns / 1e9, done + step + 1)
        done += len(episode.actions)
        played_ns += int(episode.t_ns[-1] - episode.t_ns[0])
    return tallies
