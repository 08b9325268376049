"""A pool of simulated people: each plays the protocol once.

Where nothing but the player acts on the world they play without session and log, which takes a fraction of the time and
comes to the same keys; elsewhere through the same sessions and logs as everybody.
"""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pandas as pd

from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.errors import ReportError
from minihuman.players.choose import make_player
from minihuman.power.bare import all_playable, play_bare
from minihuman.seats.simulate import simulate
from minihuman.study.expand import enrol, expand
from minihuman.study.protocol import Protocol, decode
from minihuman.worlds.adapt.world import World

_COLUMNS = [
    *("participant", "group", "block", "episode", "outcome", "reward", "steps"),
    *("max_steps", "feasible_steps"),
]


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """What simulated people did in the block that groups are compared on: one row an episode."""

    block: str
    group: str  # whose people they are: both arms of a study are drawn from them
    episodes: pd.DataFrame

    @property
    def people(self) -> int:
        """How many there are."""
        return int(self.episodes["participant"].nunique())


def play_pool(
    toml: bytes, *, people: int, player: str, seed: int, block: str | None = None, processes: int | None = None
) -> Pool:
    """Let so many simulated people of the protocol's last group play, on all cores; nothing is left on the disk.

    ``block`` is the one to look at, None for the last that they play.

    Raises:
        ProtocolError: if the protocol cannot be understood.
        PlayerError: if there is no such player, or it cannot play a block's world.
        ReportError: if they play no such block.
    """
    group = decode(toml, "protocol").groups[-1].name
    workers = min(processes or os.cpu_count() or 1, people)
    shares = [(len(part), seed * 1_000 + number) for number, part in enumerate(np.array_split(range(people), workers))]
    work = partial(_play_share, toml, group, player)
    if workers == 1:
        tables = [work(shares[0])]
    else:
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            tables = list(pool.map(work, shares))
    rows = pd.concat(tables, keys=range(len(tables)), names=["share"]).reset_index(level="share")
    rows["participant"] = rows["share"].astype(str) + "/" + rows["participant"]
    played = list(dict.fromkeys(rows["block"]))
    if block is not None and block not in played:
        raise ReportError(f"--block is {block!r}; group {group} plays {', '.join(played) or 'nothing'}")
    chosen = block or played[-1]
    return Pool(chosen, group, rows.loc[rows["block"] == chosen, _COLUMNS].reset_index(drop=True))


def _play_share(toml: bytes, group: str, player: str, job: tuple[int, int]) -> pd.DataFrame:
    people, seed = job
    protocol = decode(toml, "protocol")
    groups = tuple(one for one in protocol.groups if one.name == group)
    study = msgspec.structs.replace(protocol.study, participants=people, seed=seed)
    alone = msgspec.structs.replace(protocol, study=study, groups=groups)
    if all_playable(alone):
        return _play_bare_share(alone, player, seed)
    with TemporaryDirectory(prefix="minihuman-power-") as folder:
        for _ in simulate(alone, Path(folder), participants=people, seed=seed, player=player):
            pass
        sessions = Sessions(Path(folder), Selection(), processes=1).rows(with_shortest=True)
        tables: list[pd.DataFrame] = [one.rows["episodes"].to_pandas()[_COLUMNS] for one in sessions]
        return pd.concat(tables)


def _play_bare_share(protocol: Protocol, player: str, seed: int) -> pd.DataFrame:
    rows, worlds = list[dict[str, object]](), dict[int, World]()
    for index in range(protocol.study.participants):
        plan = expand(protocol, enrol(protocol, index))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        traces = play_bare(plan, make_player(player, rng), worlds)
        rows += [
            {
                "participant": plan.participant.id,
                "group": plan.participant.group,
                "block": episode.block_name,
                "episode": episode.episode + 1,
                "outcome": trace.outcome,
                "reward": trace.reward,
                "steps": trace.steps,
                "max_steps": trace.limit,
                "feasible_steps": trace.best,
            }
            for episode, trace in zip(plan.episodes, traces, strict=True)
        ]
    return pd.DataFrame(rows, columns=_COLUMNS)


def groups_of(text: str) -> tuple[int, ...]:
    """Numbers of participants a group, as in ``10,20``.

    Raises:
        ReportError: if they are none, or one is below two.
    """
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = (0,)
    if min(sizes) < 2:
        raise ReportError(f"--groups is {text!r}; write whole numbers of 2 or more, as in 10,20,40")
    return sizes
