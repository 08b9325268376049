"""Keys: when each one's action is discovered, and what is pressed in vain.

A step has a visible effect if the observation after it differs from the one before it.
"""

from collections import Counter
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
        tried = {press.key for episode in under for press in episode.keys if press.down}
        others = sorted({*key_map.spare_keys, *tried} - set(key_map.keys))
        rows += [_use(key, key_map.keys.get(key), under) for key in (*sorted(key_map.keys), *others)]
    return tuple(rows)


def _use(key: str, action: str | None, under: Sequence[Episode]) -> KeyUse:
    verdicts: Counter[str] = Counter()
    steps = in_vain = done = 0
    played_ns = 0
    found: tuple[float, int] | None = None
    for episode in under:
        verdicts.update(press.verdict for press in episode.keys if press.key == key and press.down)
        mine = np.array([cause == key for cause in episode.step_keys], bool)
        effect = visible_effect(episode)
        steps += int(mine.sum())
        in_vain += int((mine & ~effect).sum())
        showed = np.flatnonzero(mine & effect)
        if found is None and showed.size:
            first = int(showed[0])
            found = ((played_ns + int(episode.key_t_ns[first] - episode.t_ns[0])) / 1e9, done + first + 1)
        done += len(episode.actions)
        played_ns += int(episode.t_ns[-1] - episode.t_ns[0])
    presses = sum(verdicts.values()) - verdicts["repeat"]
    return KeyUse(
        key=key,
        action=action,
        first_episode=under[0].plan.episode,
        presses=presses,
        steps=steps,
        in_vain=in_vain,
        refused=presses - verdicts["accepted"] - verdicts["queued"],
        found_s=found[0] if found and action is not None else None,
        found_steps=found[1] if found and action is not None else None,
    )
