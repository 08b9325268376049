"""Keys: when each one's action is discovered, and what is pressed in vain.

A step has a visible effect if the observation after it differs from the one before it.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import compress, groupby

import numpy as np
from numpy.typing import NDArray

from minihuman.log.episode import Episode

_TAKEN = ("accepted", "queued")  # verdicts of presses that were answered by a step


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
        tally = _tally(under)
        others = {*key_map.spare_keys, *tally.presses, *tally.steps} - {*key_map.keys, ""}  # "" caused a tick's no-op
        for key in (*sorted(key_map.keys), *sorted(others)):
            action = key_map.keys.get(key)
            found_s, found_steps = tally.found.get(key, (None, None)) if action is not None else (None, None)
            rows.append(
                KeyUse(
                    key=key,
                    action=action,
                    first_episode=under[0].plan.episode,
                    presses=tally.presses[key],
                    steps=tally.steps[key],
                    in_vain=tally.in_vain[key],
                    refused=tally.refused[key],
                    found_s=found_s,
                    found_steps=found_steps,
                )
            )
    return tuple(rows)


def refused_presses(episode: Episode) -> int:
    """How many presses in an episode had no action, or came while none was taken; auto-repeats left out."""
    return sum(verdict not in _TAKEN for _, verdict in _presses(episode))


def _presses(episode: Episode) -> Iterator[tuple[str, str]]:
    """Key and verdict of everything that went down, auto-repeats left out."""
    columns = (episode.keys.column(name) for name in ("key", "down", "verdict"))
    return ((key, verdict) for key, down, verdict in zip(*columns, strict=True) if down and verdict != "repeat")


@dataclass(slots=True)
class _Tally:
    """Counts by key under one key map, and playing time and steps until each key's action first showed."""

    presses: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    steps: Counter[str] = field(default_factory=Counter)
    in_vain: Counter[str] = field(default_factory=Counter)
    found: dict[str, tuple[float, int]] = field(default_factory=dict)


def _tally(under: Sequence[Episode]) -> _Tally:
    tally = _Tally()
    done = played_ns = 0
    for episode in under:
        down = list(_presses(episode))
        tally.presses.update(key for key, _ in down)
        tally.refused.update(key for key, verdict in down if verdict not in _TAKEN)
        shows = visible_effect(episode)
        causes = episode.step_keys
        tally.steps.update(causes)
        tally.in_vain.update(compress(causes, (~shows).tolist()))
        # the earliest step comes last, and stays
        first = {causes[step]: step for step in reversed(np.flatnonzero(shows).tolist())}
        for key, step in first.items():
            if key not in tally.found:
                since_ns = played_ns + int(episode.key_t_ns[step] - episode.t_ns[0])
                tally.found[key] = (since_ns / 1e9, done + step + 1)
        done += len(episode.actions)
        played_ns += int(episode.t_ns[-1] - episode.t_ns[0])
    return tally
