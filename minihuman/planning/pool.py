"""A pool of simulated participants: each plays the protocol once.

Where nothing but the player acts on the world they play headless, without session and log, which is about ten times
faster and gives the same keys; elsewhere through the same sessions and logs as everybody.
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pandas as pd

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import PlayerFailedError, ReportError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.operating_system import count_processes
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.participant import SimulatedParticipant, make_participant
from minihuman.worlds.adapters.world import World


@dataclass(frozen=True, slots=True)
class HeadlessEpisode:
    """How one episode ended."""

    outcome: str
    reward: float
    steps: int
    shortest: int | None  # steps of the shortest path that is known
    limit: int


_PRESSES_PER_STEP = 20  # of the limit: who needs more will never find the keys


def can_run_headless(protocol: Protocol) -> bool:
    """Whether a study can be played headless: one session, self-paced, without an agent."""
    return len(protocol.sessions) <= 1 and all(
        block.kind == "play"
        and block.pace == "on_key"
        and not (block.stop_criterion or block.design or block.auto_repeat or block.max_episode_s or block.max_block_s)
        for block in protocol.blocks
    )


def play_headless(
    plan: SessionPlan, player: SimulatedParticipant, worlds: dict[int, World]
) -> tuple[HeadlessEpisode, ...]:
    """Play the episodes of a plan; ``worlds``, one per block, serve the next plan too."""
    played = []
    for episode in plan.episodes:
        if episode.block not in worlds:
            worlds[episode.block] = World(episode.world, episode.options)
        played.append(_play(episode, plan.key_pool, player, worlds[episode.block]))
    return tuple(played)


def _play(plan: EpisodePlan, pool: tuple[str, ...], player: SimulatedParticipant, world: World) -> HeadlessEpisode:
    world.reset(plan.seed)
    shortest = world.path_length_bounds().feasible
    player.begin(plan, pool, world)
    presses, steps, reward, outcome = 0, 0, 0.0, "timeout"
    while outcome == "timeout" and steps < plan.max_steps and presses < _PRESSES_PER_STEP * plan.max_steps:
        press = player.press(world)
        if press is None:
            raise PlayerFailedError(f"the simulated participant gave no answer in {plan.world}", "no answer")
        action = plan.key_map.keys.get(press.key, "")
        presses += 1
        if action:
            made = world.step(world.action_names.index(action))
            steps, reward = steps + 1, reward + made.reward
            if made.terminated:
                outcome = "goal" if made.reward > 0 else "failure"
    return HeadlessEpisode(outcome, reward, steps, shortest, plan.max_steps)


_COLUMNS = [
    *("participant", "group", "block", "episode", "outcome", "reward", "steps"),
    *("max_steps", "feasible_steps"),
]


@dataclass(frozen=True, slots=True, eq=False)
class ParticipantPool:
    """The simulated participants' episodes in the block that groups are compared on, one row each."""

    block: str
    group: str  # both arms of a study are drawn from its participants
    episodes: pd.DataFrame

    @property
    def people(self) -> int:
        """How many there are."""
        return int(self.episodes["participant"].nunique())


def simulate_pool(
    toml: bytes, *, people: int, player: str, seed: int, block: str | None = None, processes: int | None = None
) -> ParticipantPool:
    """Simulate participants of the protocol's last group, on all cores; nothing stays on disk.

    ``block`` is the block to analyse; by default the last one.

    Raises:
        ProtocolError: if the protocol cannot be understood.
        SimulationError: if there is no such player, or it cannot play a block's world.
        ReportError: if they play no such block.
    """
    group = decode_protocol(toml, "protocol").groups[-1].name
    workers = min(processes or count_processes(), people)
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
        raise ReportError(
            f"group {group} does not play block {block!r}; choose one that it plays with --block: "
            f"{', '.join(played) or 'none'}"
        )
    chosen = block or played[-1]
    return ParticipantPool(chosen, group, rows.loc[rows["block"] == chosen, _COLUMNS].reset_index(drop=True))


def _play_share(toml: bytes, group: str, player: str, job: tuple[int, int]) -> pd.DataFrame:
    people, seed = job
    protocol = decode_protocol(toml, "protocol")
    groups = tuple(one for one in protocol.groups if one.name == group)
    study = msgspec.structs.replace(protocol.study, participants=people, seed=seed)
    alone = msgspec.structs.replace(protocol, study=study, groups=groups)
    if can_run_headless(alone):
        return _play_bare_share(alone, player, seed)
    with TemporaryDirectory(prefix="minihuman-power-") as folder:
        for _ in simulate(alone, Path(folder), participants=people, seed=seed, player=player):
            pass
        sessions = StudySessions(Path(folder), Selection(), processes=1).rows(with_shortest=True)
        tables: list[pd.DataFrame] = [one.rows["episodes"].to_pandas()[_COLUMNS] for one in sessions]
        return pd.concat(tables)


def _play_bare_share(protocol: Protocol, player: str, seed: int) -> pd.DataFrame:
    rows, worlds = list[dict[str, object]](), dict[int, World]()
    for index in range(protocol.study.participants):
        plan = expand_protocol(protocol, enrol_participant(protocol, index))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        traces = play_headless(plan, make_participant(player, rng), worlds)
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
                "feasible_steps": trace.shortest,
            }
            for episode, trace in zip(plan.episodes, traces, strict=True)
        ]
    return pd.DataFrame(rows, columns=_COLUMNS)


def parse_group_sizes(text: str) -> tuple[int, ...]:
    """Numbers of participants per group, as in ``10,20``.

    Raises:
        ReportError: if they are none, or one is below two.
    """
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = (0,)
    if min(sizes) < 2:
        raise ReportError(f"--groups {text!r} is not valid; use whole numbers of 2 or more, as in 10,20,40")
    return sizes
