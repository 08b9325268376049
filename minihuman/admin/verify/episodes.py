"""Verify a log's episodes: replay them from world id, options, seed and actions, and compare every number.

The logs of a team's members are also compared with each other; a member who withdrew is only mentioned.
"""

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby, permutations
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.activities.team.message_events import MessageShown
from minihuman.activities.team.plan import PERSON
from minihuman.admin.enrolment_entries import TeamRecorded, list_team_entries
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.events import EpisodeStarted, Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode, WorldFailedError
from minihuman.experiment.picture_versions import may_draw_other_shadows, renders_same_images
from minihuman.experiment.replay import MACHINE_VERSION
from minihuman.log.model.session_log import EpisodeLog, SessionLog, TeamRecord, pose_as_row
from minihuman.log.paths import list_sessions, session_folder
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from minihuman.worlds.source_digest import rules_digest


@dataclass(frozen=True, slots=True)
class EpisodeVerification:
    """The result of replaying a log's episodes."""

    episodes: int
    steps: int
    difference: str  # the first, "episode 3 step 17: state hash ..."; "" if the log replays exactly
    n_other_renderer: int = 0  # episodes whose observations an earlier renderer drew, so that they are not compared


def describe_other_rules(log: SessionLog) -> str:
    """Describe how the rules that recorded a log differ from the current sources of worlds; "" if they do not.

    Also "" for logs that record no digest of the rules. The rules of third-party worlds are not considered.
    """
    recorded = dict.fromkeys(segment.facts["rules"] for segment in log.segments if "rules" in segment.facts)
    recorded.pop(rules_digest(), None)
    if recorded:
        return f"recorded by rules {' and '.join(recorded)}, checked by rules {rules_digest()}"
    return ""


def are_proven_by_events(log: SessionLog) -> bool:
    """Return whether a log's episodes need no separate replay if all its events equal the session machine's.

    The machine steps the same worlds with the same seeds and actions, and all its events are compared. That is not
    enough for logs of earlier rules or pictures, for worlds that failed, and for teams, whose joint actions must be
    compared, too.
    """
    has_current_rules = all(facts.get("session_rules") == str(MACHINE_VERSION) for facts in log.metadata["segments"])
    has_same_images = all(renders_same_images(segment.facts) for segment in log.segments) and not any(
        _may_have_other_shadows(log, episode.world_options) for episode in log.episodes
    )
    has_failed = any(segment.end_reason == "world_error" for segment in log.segments)
    has_team = any(episode.team is not None for episode in log.episodes)
    return has_current_rules and has_same_images and not has_failed and not has_team


def summarize_exact_replay(log: SessionLog) -> EpisodeVerification:
    """Return the result of verifying a log whose episodes are known not to differ, without replaying them."""
    return EpisodeVerification(len(log.episodes), sum(len(episode.actions) for episode in log.episodes), "")


def verify_episodes(log: SessionLog, make_world: WorldFactory = World) -> EpisodeVerification:
    """Replay every episode of a log, up to the first number that differs.

    First-person pictures that an earlier renderer drew are not compared; states, rewards and ends still are.

    Raises:
        WorldError: if a world in the log cannot be created here.
    """
    episodes = steps = n_other_renderer = 0
    has_same_images = all(renders_same_images(segment.facts) for segment in log.segments)
    for (world_id, options), group in groupby(
        log.episodes, lambda episode: (episode.plan.world, episode.world_options)
    ):
        with closing(make_world(world_id, options)) as world:
            for episode in group:
                skips_observations = world.drawn and not has_same_images
                difference = _find_first_difference(episode, world, compare_observations=not skips_observations)
                if difference and _may_have_other_shadows(log, options):
                    skips_observations = True
                    difference = _find_first_difference(episode, world, compare_observations=False)
                if difference:
                    return EpisodeVerification(episodes, steps, difference, n_other_renderer)
                n_other_renderer += skips_observations
                episodes += 1
                steps += len(episode.actions)
    return EpisodeVerification(episodes, steps, "", n_other_renderer)


def _may_have_other_shadows(log: SessionLog, options: Mapping[str, Any]) -> bool:
    """Return whether this version may draw other shadows than those in a log, in a world with these options."""
    return any(may_draw_other_shadows(segment.facts, options) for segment in log.segments)


def _find_first_difference(episode: EpisodeLog, world: World, *, compare_observations: bool) -> str:
    """Return the first difference of an episode from its replay in the world, as a line; "" if there is none.

    Args:
        episode: the logged episode.
        world: a world of the episode's id and options.
        compare_observations: whether to compare the hashes of observations, too.
    """
    try:
        return next(_list_differences(episode, world, compare_observations=compare_observations), "")
    except WorldFailedError as error:
        return f"{episode.name}: the world raises {error}"


def _list_differences(episode: EpisodeLog, world: World, *, compare_observations: bool) -> Iterator[str]:
    """Play an episode's actions again in the world, and yield a line for each difference.

    Args:
        episode: the logged episode.
        world: a world of the episode's id and options.
        compare_observations: whether to compare the hashes of observations, too.
    """
    play = RunningEpisode(episode.plan, world, picture_px=None)
    start = play.start(episode.start.t_ns)
    yield from _compare_start(episode.start, start, f"{episode.name} reset", compare_observations=compare_observations)
    for index, action in enumerate(episode.actions_taken):
        step_name = f"{episode.name} step {index + 1}"
        if play.outcome is not None:
            yield f"{step_name}: logged, but the episode now ends at step {index} with {play.outcome!r}"
        replayed = play.step(0, action, key=episode.step_keys[index], key_t_ns=0)
        yield from _compare_step(episode, index, replayed, step_name, compare_observations=compare_observations)
        if episode.team is not None:
            rewards = episode.team.rewards[index]
            if not np.array_equal(rewards, world.unwrapped.rewards, equal_nan=True):
                yield f"{step_name}: rewards {rewards.tolist()} in the log, now {list(world.unwrapped.rewards)}"
    if episode.team is not None:
        yield from _list_team_differences(episode, episode.team)
    if episode.end_cause and play.outcome is None:
        play.end(0, episode.end_cause)  # a time limit or a failure, whose time the replay of inputs compares
    if play.outcome != episode.outcome and episode.outcome not in (None, "abandoned"):
        yield f"{episode.name}: outcome {episode.outcome!r} in the log, now {play.outcome!r}"


def _list_team_differences(episode: EpisodeLog, team: TeamRecord) -> Iterator[str]:
    """Yield the contradictions inside a team's record of an episode, and between it and the seat's own actions."""
    difference = team.find_difference(episode.plan.seed)
    if difference:
        yield f"{episode.name}: {difference}"
    if not np.array_equal(team.actions[:, team.seat], episode.actions):
        yield f"{episode.name}: the joint actions of seat {team.seat} are not the seat's own"


def _compare_start(
    logged: EpisodeStarted, replayed: EpisodeStarted, step_name: str, *, compare_observations: bool
) -> Iterator[str]:
    """Yield the differences between the logged start of an episode and its start in the replay.

    Args:
        logged: the start in the log.
        replayed: the start in the replay.
        step_name: the beginning of each line, which names the episode.
        compare_observations: whether to compare the hashes of observations, too.
    """
    for name in ("action_names", "mission", "map", "pose"):
        if getattr(logged, name) != getattr(replayed, name):
            yield f"{step_name}: {name} {getattr(logged, name)!r} in the log, now {getattr(replayed, name)!r}"
    yield from _compare_hash(step_name, "state", logged.state_hash, replayed.state_hash)
    if compare_observations:
        yield from _compare_hash(step_name, "observation", logged.observation_hash, replayed.observation_hash)


def _compare_step(
    episode: EpisodeLog, index: int, replayed: Stepped, step_name: str, *, compare_observations: bool
) -> Iterator[str]:
    """Yield the differences between a logged step and the same step replayed now.

    Args:
        episode: the logged episode.
        index: the step's index; the state and the pose after the step have the next index.
        replayed: the replayed step.
        step_name: the start of each line, which names the step.
        compare_observations: whether to compare the hashes of observations, too.
    """
    state = index + 1
    yield from _compare_hash(step_name, "state", int(episode.state_hashes[state]), replayed.state_hash)
    if compare_observations:
        logged_hash = int(episode.observation_hashes[state])
        yield from _compare_hash(step_name, "observation", logged_hash, replayed.observation_hash)
    for name, logged, now in (
        ("success", _read_logged_success(episode, index), replayed.success),
        ("reward", float(episode.rewards[index]), replayed.reward),
        ("terminated", bool(episode.terminated[index]), replayed.terminated),
        ("truncated", bool(episode.truncated[index]), replayed.truncated),
    ):
        are_both_nan = logged != logged and now != now  # only NaN differs from itself
        if logged != now and not are_both_nan:
            yield f"{step_name}: {name} {logged!r} in the log, now {now!r}"
    pose = pose_as_row(replayed.pose)
    if not np.array_equal(episode.poses[state], pose, equal_nan=True):
        yield f"{step_name}: pose {episode.poses[state].tolist()} in the log, now {list(pose)}"


def _read_logged_success(episode: EpisodeLog, index: int) -> bool | None:
    """Return whether the step with an index, from 0, was a success according to the log; None if it is not recorded."""
    if episode.successes is None or np.isnan(episode.successes[index]):
        return None
    return bool(episode.successes[index])


def _compare_hash(step_name: str, name: str, logged: int, now: int) -> Iterator[str]:
    """Yield a line if the hash of the state or the observation is not as logged.

    Args:
        step_name: the start of the line, which names the step.
        name: "state" or "observation".
        logged: the hash in the log.
        now: the hash after replaying the step.
    """
    if logged != now:
        yield f"{step_name}: {name} hash {logged:016x} in the log, now {now:016x}"


_Played = dict[tuple[int, int], tuple[EpisodeLog, TeamRecord]]  # by episode and attempt


def verify_teams(study: Path) -> Iterator[tuple[str, bool]]:
    """Compare the joint actions in the logs of each team's members; yield lines, each with whether it reports success.

    A log that was cut off is compared as far as it goes.

    Raises:
        LogError: if a log cannot be read.
    """
    for entry in list_team_entries(study):
        people = [seat for seat, kind in enumerate(entry.seats) if kind == PERSON]
        if len(people) < 2:
            continue
        logs = {seat: _read_member(study, entry, str(seat)) for seat in people}
        played_by_seat = {seat: _find_team_episodes(log, entry) for seat, log in logs.items()}
        team_name = f"team {entry.team}, block {entry.block}"
        differences = [*_compare_members(played_by_seat), *_compare_messages(logs, played_by_seat)]
        yield from ((f"{team_name}: {difference}", False) for difference in differences)
        for seat in people:
            if str(seat) not in entry.members:
                yield f"{team_name}: seat {seat} withdrawn", True
        if not differences:
            yield f"{team_name}: {_describe_agreement(played_by_seat)}", True


def _describe_agreement(played_by_seat: dict[int, _Played]) -> str:
    """Describe how many joint steps the logs of a team agree on, and whose logs are here."""
    n_steps = {}
    for seat, played in played_by_seat.items():
        if played:
            n_steps[seat] = sum(len(team.actions) for _, team in played.values())
    seats = " and ".join(map(str, n_steps)) or "none"
    return f"{max(n_steps.values(), default=0)} joint steps, the same in each log here (seats {seats})"


def _read_member(study: Path, entry: TeamRecorded, seat: str) -> SessionLog | None:
    """Return the log of a team's member; None for a member who withdrew or has no log.

    Args:
        study: the study's folder.
        entry: the team's entry in the enrolment log.
        seat: the member's seat, as a text.
    """
    code = entry.members.get(seat)
    if code is None:
        return None
    folder = session_folder(study.parent, study.name, code, entry.session)
    if not folder.is_dir() or not list_sessions(folder):
        return None
    return read_log(folder)


def _find_team_episodes(log: SessionLog | None, entry: TeamRecorded) -> _Played:
    """Return the episodes that a team played in its block, from the log of a member; empty without a log."""
    if log is None:
        return {}
    return {
        (episode.plan.episode_in_block, episode.attempt): (episode, episode.team)
        for episode in log.episodes
        if episode.team is not None and (episode.team.team, episode.plan.block_name) == (entry.team, entry.block)
    }


def _compare_members(played_by_seat: dict[int, _Played]) -> Iterator[str]:
    """Yield the differences between the logs of each pair of seats.

    A member may have left, withdrawn or come back, so the same joint steps can be the first attempt at an episode in
    one log and the second in another. Each attempt is therefore compared with the other seat's attempt that agrees
    longest, and not at all if the other seat did not act in it.
    """
    lines = dict[str, None]()  # in order, each once
    for (seat, played), (other_seat, other_played) in permutations(played_by_seat.items(), 2):
        for (number, attempt), (episode, team) in played.items():
            if all(sources[other_seat] == "agent" for sources in team.sources):
                continue
            other_attempts = {
                other_attempt: record
                for (other_number, other_attempt), record in other_played.items()
                if other_number == number
            }
            if not other_attempts:
                continue
            n_same = {key: _count_equal_steps(team, other_team) for key, (_, other_team) in other_attempts.items()}
            best = max(n_same, key=lambda key: (n_same[key], key == attempt))  # of equal ones, that of the same number
            records = {seat: (episode, team), other_seat: other_attempts[best]}
            difference = _find_record_difference(dict(sorted(records.items())), n_same[best])
            if difference:
                lines[f"episode {number + 1} of the block{difference}"] = None
    yield from lines


def _find_record_difference(records: Mapping[int, tuple[EpisodeLog, TeamRecord]], n_same: int) -> str:
    """Describe where the records that two seats have of an episode differ; "" if they do not.

    Args:
        records: the episode and its team record, by seat.
        n_same: the number of joint steps from the start on which both records agree.
    """
    (episode, team), (other, other_team) = records.values()
    seats = " and ".join(map(str, records))
    n_steps = min(len(team.actions), len(other_team.actions))
    n_states = n_steps + 1
    if n_same < n_steps:
        logged = [f"seat {seat} logged {record.actions[n_same].tolist()}" for seat, (_, record) in records.items()]
        return f" step {n_same + 1}: {', '.join(logged)}"
    is_different = episode.state_hashes[:n_states] != other.state_hashes[:n_states]
    if is_different.any():
        first_different = int(is_different.argmax())
        return f" step {first_different}: seats {seats} logged different states"
    if len(team.actions) == len(other_team.actions) and team.digest != other_team.digest:
        return f": seats {seats} logged different digests"
    return ""


def _compare_messages(logs: dict[int, SessionLog | None], played_by_seat: dict[int, _Played]) -> Iterator[str]:
    """Yield a line for each message that a seat was shown but that its author's log lacks, if that log is complete.

    Args:
        logs: the log of each seat; None if it is not here.
        played_by_seat: the team's episodes according to each log.
    """
    shown_messages = {}
    sent = {}
    for seat, log in logs.items():
        if log is None:
            continue
        messages = _list_shown_messages(log, played_by_seat[seat])
        shown_messages[seat] = messages
        if log.segments[-1].clean:
            sent[seat] = {message.digest for message in messages if message.seat == seat}
    for seat, messages in shown_messages.items():
        for message in messages:
            if message.seat in sent and message.digest not in sent[message.seat]:
                yield (
                    f"episode {message.episode + 1}: seat {seat} was shown a message that seat {message.seat} did not "
                    "send"
                )


def _list_shown_messages(log: SessionLog, played: _Played) -> list[MessageShown]:
    """Return the messages that were shown to a seat in the team's episodes.

    Args:
        log: the log of the seat.
        played: the team's episodes according to this log.
    """
    episodes = {episode.plan.episode for episode, _ in played.values()}
    return [event for event in log.part_events if isinstance(event, MessageShown) and event.episode in episodes]


def _count_equal_steps(record: TeamRecord, other: TeamRecord) -> int:
    """Return the number of joint steps on which two records agree before their first difference."""
    n_compared = min(len(record.actions), len(other.actions))
    is_equal = (record.actions[:n_compared] == other.actions[:n_compared]).all(axis=1)
    return int(is_equal.cumprod().sum())  # the product is 0 from the first difference on
