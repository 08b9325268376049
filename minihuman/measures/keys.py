"""Keys: when each one's action is discovered, and what is pressed in vain.

A step has a visible effect if the observation after it differs from the one before it.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from minihuman.measures.timing import played_ns
from minihuman.recorded.categorical import Words
from minihuman.recorded.episode import Episode
from minihuman.study.plan import KeyMap

_TAKEN = ("accepted", "queued")  # verdicts of presses that were answered by a step


@dataclass(frozen=True, slots=True)
class KeyUse:
    """One key under one key map: how it was used, and when what it does first showed.

    ``found_s`` is playing time in episodes, and ``found_steps`` the steps done up to and with that press, since the key
    map came into force; both None while its action never showed.
    """

    key: str
    action: str | None  # None: no action
    first_episode: int  # the key map's first, by Episode.number
    presses: int  # all that went down while an episode ran, auto-repeats left out
    steps: int  # that stepped the world
    in_vain: int  # steps without a visible effect
    refused: int  # presses with no action, or while no action was taken
    found_s: float | None
    found_steps: int | None


def visible_effect(episode: Episode) -> NDArray[np.bool_]:
    """Whether each step changed what is seen, (n,)."""
    return np.not_equal(episode.observation_hashes[1:], episode.observation_hashes[:-1])


@dataclass(frozen=True, slots=True)
class Tally:
    """One episode's presses and steps by key, auto-repeats left out, and where each key's action first showed."""

    episode: Episode
    presses: Counter[str]
    refused: Counter[str]
    steps: Counter[str]
    in_vain: Counter[str]
    first_shown: dict[str, int]  # the first step with a visible effect, from 0

    @classmethod
    def of(cls, episode: Episode) -> "Tally":
        """Count an episode's."""
        keys = episode.keys
        key, verdict = keys.column("key"), keys.column("verdict")
        pressed = keys.column("down") & ~verdict.are(("repeat",))
        causes, shows = Words.of(episode.step_keys), visible_effect(episode)
        return cls(
            episode,
            presses=key.counted(pressed),
            refused=key.counted(pressed & ~verdict.are(_TAKEN)),
            steps=causes.counted(),
            in_vain=causes.counted(~shows),
            first_shown=causes.first(shows),
        )


def key_uses(tallies: Sequence[Tally]) -> tuple[KeyUse, ...]:
    """How every key was used, one row for each key of each key map, and for each other key that was tried."""
    rows: list[KeyUse] = []
    for key_map, under in _by_key_map(tallies):
        presses, refused, steps, in_vain = (
            _total(getattr(tally, name) for tally in under) for name in ("presses", "refused", "steps", "in_vain")
        )
        found = _found(under)
        others = {*key_map.spare_keys, *+presses, *+steps} - {*key_map.keys, ""}  # "" caused a tick's no-op
        for key in (*sorted(key_map.keys), *sorted(others)):
            action = key_map.keys.get(key)
            found_s, found_steps = found.get(key, (None, None)) if action is not None else (None, None)
            rows.append(
                KeyUse(
                    key=key,
                    action=action,
                    first_episode=under[0].episode.number,
                    presses=presses[key],
                    steps=steps[key],
                    in_vain=in_vain[key],
                    refused=refused[key],
                    found_s=found_s,
                    found_steps=found_steps,
                )
            )
    return tuple(rows)


def times_to_find(tallies: Sequence[Tally]) -> list[float | None]:
    """``KeyUse.found_s`` of every key that has an action."""
    return [
        found[key][0] if key in found else None
        for key_map, under in _by_key_map(tallies)
        for found in [_found(under)]
        for key in key_map.keys
    ]


def _by_key_map(tallies: Iterable[Tally]) -> Iterator[tuple[KeyMap, list[Tally]]]:
    """The episodes that were played one after the other under the same key map."""
    for key_map, run in groupby(tallies, key=lambda tally: tally.episode.plan.key_map):
        yield key_map, list(run)


def _total(counts: Iterable[Counter[str]]) -> Counter[str]:
    total: Counter[str] = Counter()
    for count in counts:
        total.update(count)
    return total


def _found(under: Sequence[Tally]) -> dict[str, tuple[float, int]]:
    """Playing time, s, pauses left out, and steps under one key map until each key's action first showed."""
    found: dict[str, tuple[float, int]] = {}
    done = before_ns = 0
    for tally in under:
        episode = tally.episode
        for key, step in tally.first_shown.items():
            if key not in found:
                since_ns = before_ns + played_ns(episode, int(episode.key_t_ns[step]))
                found[key] = (since_ns / 1e9, done + step + 1)
        done += len(episode.actions)
        before_ns += played_ns(episode)
    return found
