"""Statistical power by simulation.

Studies with a known effect are drawn from a pool, and the share in which the report's own test finds the effect is
written as text, CSV and figure.

In the pool, each simulated participant plays the protocol once. If only the player acts on the world, participants play
headless, without session and log, which is about ten times faster and gives the same keys; otherwise they play through
ordinary sessions and logs.
"""

import math
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from minihuman.dataset.measures import log_excess_steps, log_steps_ratio, spl
from minihuman.dataset.tables import select
from minihuman.errors import PlayerFailedError, ReportError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.plan.stated_outcomes import HOW_TO_STATE_A_RULE
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.figures.style import COLUMN_CM, MUTED, SERIES, figure_style, save_figure
from minihuman.operating_system import count_processes
from minihuman.runtime.simulated_session import simulate
from minihuman.simulation.participant import NoPress, SimulatedParticipant, make_participant
from minihuman.statistics.permutation import permutation_tests
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.t_tests import Values
from minihuman.statistics.two_part_model import summarise_people, two_parts_p
from minihuman.worlds.adapters.world import World
from minihuman.worlds.outcomes import OutcomeJudge


@dataclass(frozen=True, slots=True)
class HeadlessEpisode:
    """The outcome, reward and length of an episode that was played headless."""

    outcome: str
    reward: float
    steps: int
    shortest: int | None  # steps of the shortest path that is known
    limit: int


_PRESSES_PER_STEP = 20  # key presses per step of the limit, after which an episode is given up


def can_run_headless(protocol: Protocol) -> bool:
    """Return whether a study can be played headless, without sessions and logs.

    It must have one session and blocks of plain play that only key presses advance and only the world ends.
    """
    return len(protocol.sessions) <= 1 and all(
        find_kind(block.kind).is_plain_play
        and block.pace == "on_key"
        and not (block.stop_criterion or block.design or block.auto_repeat or block.max_episode_s or block.max_block_s)
        for block in protocol.blocks
    )


def play_headless(
    plan: SessionPlan, player: SimulatedParticipant, worlds: dict[int, World]
) -> tuple[HeadlessEpisode, ...]:
    """Play the episodes of a plan, and return how they ended.

    Args:
        plan: the plan of the session.
        player: the simulated participant.
        worlds: one world per block, which later plans use again; missing ones are added.
    """
    played_episodes = []
    for episode in plan.episodes:
        if episode.block not in worlds:
            worlds[episode.block] = World(episode.world, episode.options)
        played_episodes.append(_play_episode(episode, plan.key_pool, player, worlds[episode.block]))
    return tuple(played_episodes)


def _play_episode(
    plan: EpisodePlan, pool: tuple[str, ...], player: SimulatedParticipant, world: World
) -> HeadlessEpisode:
    """Play one episode until it ends, or until so many keys are pressed that the player will never find the right ones.

    ``pool`` has the keys that may have an action.

    Raises:
        PlayerFailedError: if the participant gives no answer.
    """
    world.reset(plan.seed)
    shortest = world.path_length_bounds().feasible
    player.begin(plan, pool, world)
    judge = OutcomeJudge(plan.outcome_rule)
    outcome: str | None = None
    n_presses = 0
    steps = 0
    reward = 0.0
    while outcome is None and n_presses < _PRESSES_PER_STEP * plan.max_steps:
        press = player.press(world)
        if press is None:
            raise PlayerFailedError(f"the simulated participant gave no answer in {plan.world}", "no answer")
        if isinstance(press, NoPress):
            action = plan.noop or ""
        else:
            action = plan.key_map.keys.get(press.key, "")
        n_presses += 1
        if action:
            transition = world.step(world.action_names.index(action))
            steps += 1
            reward += transition.reward
            facts = transition.collect_facts(judge.rule, return_=reward, spent=steps >= plan.max_steps)
            outcome = judge.judge_step(facts)
    return HeadlessEpisode(outcome or judge.judge_time_limit(), reward, steps, shortest, plan.max_steps)


_COLUMNS = [
    *("participant", "group", "block", "episode", "outcome", "reward", "steps"),
    *("max_steps", "feasible_steps"),
]


_MOST_JOBS = 1_000  # each seed has so many seeds of jobs, which no other seed has


@dataclass(frozen=True, slots=True, eq=False)
class ParticipantPool:
    """The episodes of simulated participants in the block in which groups are compared, one row per episode."""

    block: str
    group: str  # both arms of a study are drawn from its participants
    episodes: pd.DataFrame

    @property
    def people(self) -> int:
        """Return the number of participants."""
        return int(self.episodes["participant"].nunique())


def simulate_pool(
    toml: bytes, *, people: int, player: str, seed: int, block: str | None = None, processes: int | None = None
) -> ParticipantPool:
    """Simulate participants of the protocol's last group on several processor cores, without leaving files on disk.

    Args:
        toml: the protocol.
        people: the number of participants.
        player: the simulated participant's name and settings.
        seed: the seed of the simulation.
        block: the block to analyse; by default the last one.
        processes: the number of processes; by default one per core.

    Raises:
        ProtocolError: if the protocol is invalid.
        SimulationError: if there is no such player, or it cannot play a block's world.
        ReportError: if the group does not play the block.
    """
    group = decode_protocol(toml, "protocol").groups[-1].name
    workers = min(processes or count_processes(), people)
    shares = np.array_split(range(people), workers)
    jobs = [(len(share), seed * _MOST_JOBS + index) for index, share in enumerate(shares)]
    simulate_job = partial(_simulate_job, toml, group, player)
    if workers == 1:
        tables = [simulate_job(jobs[0])]
    else:
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            tables = list(pool.map(simulate_job, jobs))
    rows = pd.concat(tables, keys=range(len(tables)), names=["share"]).reset_index(level="share")
    rows["participant"] = rows["share"].astype(str) + "/" + rows["participant"]
    played_blocks = list(dict.fromkeys(rows["block"]))
    if block is not None and block not in played_blocks:
        raise ReportError(
            f"group {group} does not play block {block!r}; choose one that it plays with --block: "
            f"{', '.join(played_blocks) or 'none'}"
        )
    target = block or played_blocks[-1]
    return ParticipantPool(target, group, rows.loc[rows["block"] == target, _COLUMNS].reset_index(drop=True))


def _simulate_job(toml: bytes, group: str, player: str, job: tuple[int, int]) -> pd.DataFrame:
    """Simulate participants of one group of a protocol, and return their episodes, a row of `_COLUMNS` each.

    ``job`` has the number of participants and the seed.
    """
    people, seed = job
    protocol = decode_protocol(toml, "protocol")
    groups = tuple(group_spec for group_spec in protocol.groups if group_spec.name == group)
    study = msgspec.structs.replace(protocol.study, participants=people, seed=seed)
    group_protocol = msgspec.structs.replace(protocol, study=study, groups=groups)
    if can_run_headless(group_protocol):
        return _simulate_headless(group_protocol, player, seed)
    with TemporaryDirectory(prefix="minihuman-power-") as folder:
        for _ in simulate(group_protocol, Path(folder), participants=people, seed=seed, player=player):
            pass
        with select(Path(folder), processes=1) as tables:
            tables.require(("episodes",), shortest_paths=True)
            return tables.frame("episodes", _COLUMNS)


def _simulate_headless(protocol: Protocol, player: str, seed: int) -> pd.DataFrame:
    """Simulate a protocol's participants without sessions or logs, and return their episodes, a row each."""
    rows = list[dict[str, object]]()
    worlds = dict[int, World]()
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
    """Parse numbers of participants per group, as in ``10,20``.

    Raises:
        ReportError: if the text has no such numbers, or one is below two.
    """
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = (0,)
    if min(sizes) < 2:
        raise ReportError(f"--groups {text!r} is not valid; use whole numbers of 2 or more, as in 10,20,40")
    return sizes


ALPHA = 0.05
_POOLS = 20  # resamples of the pool
_Z = 1.96  # of a 95 % interval of a normal distribution
TWO_PARTS = "reward_two_parts"  # the share of episodes with a reward, and its amount in these


@dataclass(frozen=True, slots=True)
class Effect:
    """The effect in the first group: its steps in excess of the shortest path are multiplied by ``excess``."""

    excess: float = 1.0

    @classmethod
    def parse(cls, text: str) -> "Effect":
        """Parse an effect, ``excess=0.7`` or ``none``.

        Raises:
            ReportError: if the text is anything else.
        """
        if text == "none":
            return cls()
        name, _, number = text.partition("=")
        try:
            excess = float(number)
        except ValueError:
            excess = math.nan
        if name != "excess" or not 0 < excess < math.inf:
            raise ReportError(f"--effect {text!r} is not valid; use none, or excess=0.7 for 30 % fewer excess steps")
        return cls(excess)

    def of(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of a pool's episodes as they would have been played with the effect.

        An episode that timed out is not changed, because its remaining steps are unknown; power is therefore slightly
        underestimated. Reward is assumed to fall linearly from that of the shortest path, as Minigrid's and Miniworld's
        does.
        """
        if self.excess == 1.0:
            return rows
        is_changed = (rows["outcome"] == "goal") & rows["feasible_steps"].notna()
        new_steps = rows["feasible_steps"] + self.excess * (rows["steps"] - rows["feasible_steps"])
        reward_per_step = (1 - rows["reward"]) / rows["steps"].clip(lower=1)
        return rows.assign(
            steps=rows["steps"].where(~is_changed, new_steps),
            reward=rows["reward"].where(~is_changed, 1 - reward_per_step * new_steps),
        )


def _measure_episodes(rows: pd.DataFrame, measure: Callable[..., float | None]) -> list[float]:
    """Return a measure of each episode, NaN for an episode without it.

    ``measure`` takes an episode's steps, fewest steps, limit of steps and outcome, and returns None for no measure.
    """
    episodes = rows[["steps", "feasible_steps", "max_steps", "outcome"]].itertuples(index=False)
    measured = (measure(*episode) for episode in episodes)
    return [math.nan if number is None else number for number in measured]


def _to_whole(steps: float) -> int | None:
    """Return the fewest steps as a whole number, or None if they are unknown."""
    if pd.isna(steps):
        return None
    return int(steps)


def _mask_ended(rows: pd.DataFrame, numbers: "pd.Series[float]") -> list[float]:
    """Return a number for each episode, but NaN for an episode that ended without a known outcome."""
    masked: list[float] = numbers.where(rows["outcome"] != "ended").tolist()
    return masked


MEASURES: Mapping[str, Callable[[pd.DataFrame], Sequence[float]]] = {
    "log_excess_steps": lambda rows: _measure_episodes(
        rows, lambda steps, best, limit, outcome: log_excess_steps(steps, _to_whole(best), int(limit), outcome)
    ),
    "log_steps_ratio": lambda rows: _measure_episodes(
        rows, lambda steps, best, limit, outcome: log_steps_ratio(steps, _to_whole(best), int(limit), outcome)
    ),
    "spl": lambda rows: _measure_episodes(rows, lambda steps, best, _, outcome: spl(steps, _to_whole(best), outcome)),
    "steps_at_limit": lambda rows: _mask_ended(rows, rows["steps"].where(rows["outcome"] == "goal", rows["max_steps"])),
    "reward": lambda rows: rows["reward"].tolist(),
    "success": lambda rows: _mask_ended(rows, (rows["outcome"] == "goal").astype(float)),
}


@dataclass(frozen=True, slots=True)
class PowerEstimate:
    """The share of studies that find the effect on a measure, with its interval."""

    measure: str
    participants: int  # per group
    power: float
    low: float  # Monte Carlo 95 % interval
    high: float
    studies: int


def compute_values(rows: pd.DataFrame, measure: str) -> Values:
    """Return each participant's mean of a measure over episodes, (n,); for the reward in two parts, two values, (n, 2).

    Raises:
        ReportError: if the measure is unknown, or too few participants have a value.
    """
    if measure == TWO_PARTS:
        return summarise_people(rows, "reward")
    if measure not in MEASURES:
        raise ReportError(f"--measure {measure!r} is unknown; use all or one of {', '.join((*MEASURES, TWO_PARTS))}")
    if measure != "reward" and (rows["outcome"] == "ended").all():
        raise ReportError(
            f"--measure {measure} needs success, but no rule says what success is in the block; {HOW_TO_STATE_A_RULE}, "
            "or use --measure reward"
        )
    means = rows.assign(value=MEASURES[measure](rows)).groupby("participant")["value"].mean().dropna()
    if len(means) < 2:
        raise ReportError(
            f"only {len(means)} simulated participants have a value for {measure}, but two are needed; "
            "use a world with a known shortest path"
        )
    return means.to_numpy(float)


def power_curve(
    measure: str, treated: Values, untreated: Values, sizes: Sequence[int], *, studies: int, seed: int
) -> tuple[PowerEstimate, ...]:
    """Return the power at each group size: the share of simulated studies in which the report's test finds the effect.

    Each study draws participants with replacement into two groups. The pool itself is resampled up to twenty times; the
    variation of power between the resamples shows how much it depends on the participants who happen to be in the pool.

    Args:
        measure: the name of the measure.
        treated: the values of the pool's participants with the effect.
        untreated: the values of the same participants without the effect.
        sizes: the numbers of participants per group.
        studies: the number of studies per size.
        seed: the seed of the draws.
    """
    return tuple(_estimate_power(measure, treated, untreated, size, studies=studies, seed=seed) for size in sizes)


def _estimate_power(
    measure: str, treated: Values, untreated: Values, size: int, *, studies: int, seed: int
) -> PowerEstimate:
    """Estimate the power at one group size; the arguments are those of ``power_curve``.

    The interval combines that of the share of studies (Wilson) with the variation of power between resamples of the
    pool, beyond the variation that is due to the number of studies.
    """
    test = _compute_group_p if untreated.ndim == 1 else two_parts_p
    rng = np.random.default_rng([seed, size])
    hits = list[int]()  # of each resampled pool, the studies that find the effect
    counts = [len(part) for part in np.array_split(range(studies), min(_POOLS, studies))]
    for count in counts:
        pool = rng.integers(len(untreated), size=len(untreated))
        n_hits = 0
        for _ in range(count):
            n_hits += test(treated[rng.choice(pool, size)], untreated[rng.choice(pool, size)]) < ALPHA
        hits.append(n_hits)
    power = sum(hits) / studies
    shares = np.array(hits) / np.array(counts)
    chance_variance = power * (1 - power) * float(np.mean(1 / np.array(counts)))  # between pools that do not differ
    pool_variance = 0.0
    if len(shares) > 1:
        pool_variance = max(float(shares.var(ddof=1)) - chance_variance, 0.0)
    low, high = wilson_interval(sum(hits), studies)
    pool_margin = _Z * math.sqrt(pool_variance)
    low = power - math.hypot(power - low, pool_margin)
    high = power + math.hypot(high - power, pool_margin)
    return PowerEstimate(measure, size, power, max(low, 0.0), min(high, 1.0), studies)


def _compute_group_p(first: Values, second: Values) -> float:
    """Return the p of the report's test of two groups; NaN if one has fewer than two participants."""
    (test,) = permutation_tests([(first, second)])
    if test is None:
        return math.nan
    return test.p()


_USUAL_POWER = 0.8  # that studies are planned for, drawn as a line
_INCHES_PER_CM = 1 / 2.54
_FIGURE_HEIGHT_CM = 7.2
_MARKERS = "os^DvPX"
_CELL_WIDTH = 22  # characters of a column of the table of power


def describe_power(pool: ParticipantPool, effect: Effect, estimates: Sequence[PowerEstimate], *, player: str) -> str:
    """Return the power analysis as text, for the terminal and a preregistration."""
    if effect.excess == 1:
        effect_text = "no effect"
    else:
        effect_text = f"excess steps times {effect.excess:g} in one of two groups"
    studies = estimates[0].studies
    lines = [
        f"Power for {effect_text}, block {pool.block}: the share of {studies:,} studies with p < {ALPHA:g}",
        f"(permutation of |Welch's t| over participants' means), people drawn from {pool.people} simulated ones of",
        f"group {pool.group}, player {player}. In brackets (95 %): the Monte Carlo interval.",
        "Whether real participants are like the simulated ones is not tested.",
        "",
    ]
    return "\n".join([*lines, *tabulate_power(estimates)])


def tabulate_power(estimates: Sequence[PowerEstimate]) -> Iterator[str]:
    """Yield the lines of a table with a row per measure and a column per number of participants."""
    sizes = sorted({estimate.participants for estimate in estimates})
    heading = "participants per group"
    width = max(len(heading), *(len(estimate.measure) + 2 for estimate in estimates))
    yield _format_table_row(heading, width, [str(size) for size in sizes])
    for measure in dict.fromkeys(estimate.measure for estimate in estimates):
        by_size = {estimate.participants: estimate for estimate in estimates if estimate.measure == measure}
        rows = [by_size[size] for size in sizes if size in by_size]
        cells = [f"{estimate.power:.2f} ({estimate.low:.2f} to {estimate.high:.2f})" for estimate in rows]
        yield _format_table_row(measure, width, cells)


def _format_table_row(label: str, width: int, cells: Sequence[str]) -> str:
    return label.ljust(width) + "".join(cell.rjust(_CELL_WIDTH) for cell in cells)


def write_power(estimates: Sequence[PowerEstimate], out: Path) -> tuple[Path, ...]:
    """Write ``power.csv`` and the figure ``power`` into a folder, and return the paths of the files."""
    out.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(estimates).rename(columns={"participants": "participants_a_group"})
    table.to_csv(out / "power.csv", index=False)
    return (out / "power.csv", *save_figure(power_figure(estimates), out / "power"))


def power_figure(estimates: Sequence[PowerEstimate]) -> Figure:
    """Draw power against the number of participants per group, one line per measure, with Monte Carlo intervals."""
    with figure_style():
        size_in = (COLUMN_CM * _INCHES_PER_CM, _FIGURE_HEIGHT_CM * _INCHES_PER_CM)
        figure = Figure(figsize=size_in, layout="constrained")
        axes = figure.subplots()
        sorted_estimates = sorted(estimates, key=lambda estimate: estimate.participants)
        for index, measure in enumerate(dict.fromkeys(estimate.measure for estimate in estimates)):
            measure_estimates = [estimate for estimate in sorted_estimates if estimate.measure == measure]
            sizes = [estimate.participants for estimate in measure_estimates]
            low = [estimate.low for estimate in measure_estimates]
            high = [estimate.high for estimate in measure_estimates]
            powers = [estimate.power for estimate in measure_estimates]
            colour = SERIES[index % len(SERIES)]
            marker = _MARKERS[index % len(_MARKERS)]
            axes.fill_between(sizes, low, high, color=colour, alpha=0.2)
            axes.plot(sizes, powers, f"{marker}-", color=colour, markersize=3, label=measure.replace("_", " "))
        axes.axhline(_USUAL_POWER, color=MUTED, linewidth=0.6, linestyle=":")
        axes.set(xlabel="participants per group", ylabel="power", ylim=(0, 1.02))
        figure.legend(loc="outside upper center", ncols=3)
    return figure
