"""Verify a log's episodes: replay them from world id, options, seed and actions, and compare every number.

The logs of a team's members are compared with each other too; a member who withdrew is only named.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby, permutations
from pathlib import Path

import numpy as np

from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.plan import PERSON
from minihuman.admin.enrolment_entries import TeamRecorded, list_team_entries
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import EpisodeStarted, Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode, WorldFailedError
from minihuman.experiment.replay import renders_same_images
from minihuman.log.model.session_log import EpisodeLog, SessionLog, TeamRecord, pose_as_row
from minihuman.log.paths import list_sessions, session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from minihuman.worlds.source_digest import rules_digest


@dataclass(frozen=True, slots=True)
class EpisodeVerification:
    """What playing a log again gave."""

    episodes: int
    steps: int
    difference: str  # the first, "episode 3 step 17: state hash ..."; "" if the log replays exactly
    n_other_renderer: int = 0  # episodes of which what was seen is not compared: an earlier renderer drew it


def describe_other_rules(log: SessionLog) -> str:
    """What to know before a log is compared: that other sources of worlds than ours made it; "" if ours did.

    Also "" for logs of before there were digests, and for a world of somebody else's: its sources are not ours.
    """
    recorded = dict.fromkeys(segment.facts["rules"] for segment in log.segments if "rules" in segment.facts)
    recorded.pop(rules_digest(), None)
    if recorded:
        return f"recorded by rules {' and '.join(recorded)}, checked by rules {rules_digest()}"
    return ""


def verify_episodes(log: SessionLog, make_world: WorldFactory = World) -> EpisodeVerification:
    """Play every episode of a log again, up to the first number that differs.

    Pictures in first person that an earlier renderer drew are not compared; states, rewards and ends are all the same.

    Raises:
        WorldError: if a world of the log cannot be made here.
    """
    episodes = steps = n_other_renderer = 0
    same = all(renders_same_images(segment.facts) for segment in log.segments)
    for (world_id, options), group in groupby(
        log.episodes, lambda episode: (episode.plan.world, episode.world_options)
    ):
        with closing(make_world(world_id, options)) as world:
            unlike = world.drawn and not same
            for episode in group:
                difference = _first_difference(episode, world, seen=not unlike)
                if difference:
                    return EpisodeVerification(episodes, steps, difference, n_other_renderer)
                n_other_renderer += unlike
                episodes += 1
                steps += len(episode.actions)
    return EpisodeVerification(episodes, steps, "", n_other_renderer)


def _first_difference(episode: EpisodeLog, world: World, *, seen: bool) -> str:
    differences = _differences(episode, world)
    try:
        return next((each for each in differences if seen or " observation hash " not in each), "")
    except WorldFailedError as error:
        return f"{episode.name}: the world raises {error}"


def _differences(episode: EpisodeLog, world: World) -> Iterator[str]:
    plan = episode.plan
    play = RunningEpisode(plan, world, picture_px=None)
    yield from _at_start(episode.start, play.start(episode.start.t_ns), f"{episode.name} reset")
    for index, action in enumerate(episode.actions_taken):
        where = f"{episode.name} step {index + 1}"
        if play.outcome is not None:
            yield f"{where}: logged, but the episode now ends at step {index} with {play.outcome!r}"
        again = play.step(0, action, key=episode.step_keys[index], key_t_ns=0)
        yield from _at_step(episode, index, again, where)
        if episode.team is not None and not np.array_equal(
            episode.team.rewards[index], world.unwrapped.rewards, equal_nan=True
        ):
            rewards = episode.team.rewards[index].tolist()
            yield f"{where}: rewards {rewards} in the log, now {list(world.unwrapped.rewards)}"
    if episode.team is not None:
        if difference := episode.team.find_difference(plan.seed):
            yield f"{episode.name}: {difference}"
        if not np.array_equal(episode.team.actions[:, episode.team.seat], episode.actions):
            yield f"{episode.name}: the joint actions of seat {episode.team.seat} are not the seat's own"
    if episode.end_cause and episode.outcome in ("timeout", "agent_failed") and play.outcome is None:
        return  # a time limit or a failure ended it: the replay of the session's inputs compares when
    if play.outcome != episode.outcome and episode.outcome not in (None, "abandoned"):
        yield f"{episode.name}: outcome {episode.outcome!r} in the log, now {play.outcome!r}"


def _at_start(logged: EpisodeStarted, again: EpisodeStarted, where: str) -> Iterator[str]:
    for name in ("action_names", "mission", "map", "pose"):
        if getattr(logged, name) != getattr(again, name):
            yield f"{where}: {name} {getattr(logged, name)!r} in the log, now {getattr(again, name)!r}"
    yield from _hashes(where, logged.state_hash, again.state_hash, logged.observation_hash, again.observation_hash)


def _at_step(episode: EpisodeLog, index: int, again: Stepped, where: str) -> Iterator[str]:
    yield from _hashes(
        where,
        int(episode.state_hashes[index + 1]),
        again.state_hash,
        int(episode.observation_hashes[index + 1]),
        again.observation_hash,
    )
    said = np.nan if episode.successes is None else episode.successes[index]
    for name, logged, now in (
        ("success", None if np.isnan(said) else bool(said), again.success),
        ("reward", float(episode.rewards[index]), again.reward),
        ("terminated", bool(episode.terminated[index]), again.terminated),
        ("truncated", bool(episode.truncated[index]), again.truncated),
    ):
        if logged != now and not (logged != logged and now != now):  # NaN equals NaN
            yield f"{where}: {name} {logged!r} in the log, now {now!r}"
    pose = pose_as_row(again.pose)
    if not np.array_equal(episode.poses[index + 1], pose, equal_nan=True):
        yield f"{where}: pose {episode.poses[index + 1].tolist()} in the log, now {list(pose)}"


def _hashes(where: str, state: int, state_now: int, observation: int, observation_now: int) -> Iterator[str]:
    for name, logged, now in (("state", state, state_now), ("observation", observation, observation_now)):
        if logged != now:
            yield f"{where}: {name} hash {logged:016x} in the log, now {now:016x}"


_Played = dict[tuple[int, int], tuple[EpisodeLog, TeamRecord]]  # by episode and attempt


def verify_teams(study: Path) -> Iterator[tuple[str, bool]]:
    """Compare the joint actions in the logs of each team's members; yield lines, each with whether it is good news.

    A log that was cut off is compared as far as it goes.

    Raises:
        LogError: if a log cannot be read.
    """
    for entry in list_team_entries(study):
        people = [seat for seat, kind in enumerate(entry.seats) if kind == PERSON]
        if len(people) < 2:
            continue
        logs = {seat: _read_member(study, entry, str(seat)) for seat in people}
        found = {seat: _find_episodes(log, entry) for seat, log in logs.items()}
        where = f"team {entry.team}, block {entry.block}"
        gone = [seat for seat in people if str(seat) not in entry.members]
        wrong = [*_compare_members(found), *_compare_messages(logs, found)]
        yield from ((f"{where}: {line}", False) for line in wrong)
        for seat in gone:
            yield f"{where}: seat {seat} withdrawn", True
        if not wrong:
            here = {seat: played for seat, played in found.items() if played}
            steps = max((sum(len(team.actions) for _, team in played.values()) for played in here.values()), default=0)
            seats = " and ".join(map(str, here)) or "none"
            yield f"{where}: {steps} joint steps, the same in each log here (seats {seats})", True


def _read_member(study: Path, entry: TeamRecorded, seat: str) -> SessionLog | None:
    """A member's log; None of one who withdrew or has none."""
    code = entry.members.get(seat)
    if code is None:
        folder = None
    else:
        folder = session_folder(study.parent, study.name, code, entry.session)
    if folder is not None and folder.is_dir() and list_sessions(folder):
        return read_log(folder)
    return None


def _find_episodes(log: SessionLog | None, entry: TeamRecorded) -> _Played:
    return {
        (episode.plan.episode_in_block, episode.attempt): (episode, episode.team)
        for episode in (log.episodes if log is not None else ())
        if episode.team is not None and (episode.team.team, episode.plan.block_name) == (entry.team, entry.block)
    }


def _compare_members(found: dict[int, _Played]) -> Iterator[str]:
    """Where the logs of two seats differ: each pair's, as a member may have left, withdrawn, or come back.

    The same joint steps can be the first attempt at an episode in one log and the second in another. So an attempt is
    compared with that of the other seat which agrees longest, and with none where the other seat did not act in it.
    """
    lines = dict[str, None]()  # in order, each once
    for (seat, played), (other_seat, others) in permutations(found.items(), 2):
        for (number, attempt), (episode, team) in played.items():
            acted = any(sources[other_seat] != "agent" for sources in team.sources)
            if acted:
                attempts = {at: one for (of, at), one in others.items() if of == number}
            else:
                attempts = {}
            if not attempts:
                continue
            same = {at: _count_same(team, one) for at, (_, one) in attempts.items()}
            best = max(same, key=lambda at: (same[at], at == attempt))
            other, theirs = attempts[best]
            n = min(len(team.actions), len(theirs.actions))
            both = sorted(((seat, episode, team), (other_seat, other, theirs)), key=lambda one: one[0])
            seats = " and ".join(str(one[0]) for one in both)
            where = f"episode {number + 1} of the block"
            hashes = episode.state_hashes[: n + 1] == other.state_hashes[: n + 1]
            if same[best] < n:
                logged = ", ".join(f"seat {one} logged {its.actions[same[best]].tolist()}" for one, _, its in both)
                lines[f"{where} step {same[best] + 1}: {logged}"] = None
            elif not hashes.all():
                lines[f"{where} step {int((~hashes).argmax())}: seats {seats} logged different states"] = None
            elif len(team.actions) == len(theirs.actions) and team.digest != theirs.digest:
                lines[f"{where}: seats {seats} logged different digests"] = None
    yield from lines


def _compare_messages(logs: dict[int, SessionLog | None], found: dict[int, _Played]) -> Iterator[str]:
    """Which messages came onto a screen that their author's log, if it is here and whole, does not have."""
    shown = {
        seat: [
            one
            for played in [{episode.plan.episode for episode, _ in found[seat].values()}]
            for one in log.part_events
            if isinstance(one, MessageShown) and one.episode in played
        ]
        for seat, log in logs.items()
        if log is not None
    }
    sent = {
        seat: {one.digest for one in shown[seat] if one.seat == seat}
        for seat, log in logs.items()
        if log is not None and log.segments[-1].clean
    }
    yield from (
        f"episode {one.episode + 1}: seat {seat} was shown a message that seat {one.seat} did not send"
        for seat, messages in shown.items()
        for one in messages
        if one.digest not in sent.get(one.seat, {one.digest})
    )


def _count_same(one: TeamRecord, other: TeamRecord) -> int:
    """How many joint steps of two records agree before the first that differs."""
    n = min(len(one.actions), len(other.actions))
    return int((one.actions[:n] == other.actions[:n]).all(axis=1).cumprod().sum())
