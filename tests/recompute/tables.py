"""A study's logs read, and the rows of its tables recomputed from them, without importing minihuman.

Messages are decoded by the schemas that each log itself holds. The definitions are those of the data dictionary,
written down a second time: rows of the tables steps, presses, keys, episodes, blocks, participants and answers, and of
trial_stimuli, trial_sounds and trial_responses. The fewest steps of a grid are found on the floor plan in the log;
those of a first-person world only the world can tell.
"""

import csv
import json
import math
import statistics
import struct
import tomllib
from collections import Counter, defaultdict, deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

Row = dict[str, Any]
TRIAL_TABLES = ("trial_stimuli", "trial_sounds", "trial_responses")
TABLES = ("steps", "presses", "keys", "episodes", "blocks", "participants", "answers", *TRIAL_TABLES)
NOISE = 1e-9
FIRST_EPISODES = 5


@dataclass
class Episode:
    """What a log says of one attempt at an episode; times are session time, ns."""

    start: Any
    segment: int
    offset_ns: int = 0
    attempt: int = 1
    steps: list[Any] = field(default_factory=list)
    keys: list[Any] = field(default_factory=list)
    frames: list[Any] = field(default_factory=list)
    trial: Any = None  # its resolved times, of a trial with a time course
    outcome: str = "cut_off"
    last_ns: int = 0  # of the last message until it ended, since the segment began
    pauses: list[tuple[int, int]] = field(default_factory=list)

    @property
    def number(self) -> int:
        return int(self.start.plan.episode) + 1

    @property
    def block(self) -> str:
        return str(self.start.plan.block_name)

    @property
    def start_ns(self) -> int:
        return int(self.start.t_ns) + self.offset_ns

    def played_ns(self, until_ns: int | None = None) -> int:
        end = self.start_ns if not self.steps else self.steps[-1].t_ns + self.offset_ns
        end = end if until_ns is None else until_ns
        return end - self.start_ns - sum(max(0, min(end, b) - max(self.start_ns, a)) for a, b in self.pauses)

    def visible(self) -> list[bool]:
        hashes = [self.start.observation_hash, *(step.observation_hash for step in self.steps)]
        return [after != before for before, after in pairwise(hashes)]

    def key_map(self) -> tuple[Any, ...]:
        its = self.start.plan.key_map
        return tuple((one.key, one.action) for one in its.keys), tuple(its.spare_keys), its.spare, its.seed


@dataclass
class Session:
    """A log, read."""

    path: Path
    plan: Any
    protocol: dict[str, Any]
    metadata: list[tuple[str, dict[str, str]]]
    episodes: list[Episode]
    segments: int
    end_reason: str
    skipped: int
    tags: dict[int | None, set[str]]
    answers: list[tuple[int, int, Any]]  # segment, its begin in session time, the message
    pictures: list[tuple[Episode, Any]]  # of trials with a time course, each with its attempt
    sounds: list[tuple[Episode, Any]]
    trial_responses: list[tuple[Episode, Any]]
    keys: list[tuple[int, Any]]  # all of the session's, with their segment
    notes: list[Any]
    pauses: list[tuple[int, int]]
    offsets: list[int]  # where each segment begins in session time, ns

    @property
    def who(self) -> Row:
        person = self.plan.participant
        version = f"{self.plan.study_version} ({self.plan.protocol_sha256[:8]})"
        return {
            "study": self.plan.study,
            "version": version,
            "participant": person.id,
            "group": person.group,
            "session": self.plan.session,
        }

    def facts(self, name: str) -> list[dict[str, str]]:
        return [values for key, values in self.metadata if key == f"minihuman.{name}"]

    def block(self, name: str) -> Row:
        """A block of the protocol as this participant's group has it."""
        block = next(one for one in self.protocol["blocks"] if one["name"] == name)
        changes = block.get("group_overrides", block.get("for_group", {}))
        return dict(block | changes.get(self.plan.participant.group, {}))

    def practice(self) -> set[str]:
        names = [block["name"] for block in self.protocol.get("blocks", [])]
        return {name for name in names if not self.block(name).get("analysed", True)}


def read_messages(
    paths: Sequence[Path],
) -> tuple[list[tuple[str, Any]], list[tuple[str, dict[str, str]]], bytes]:
    """Every message of a session's files in order, decoded by their own schemas; their metadata; and the protocol."""
    messages: list[tuple[str, Any]] = []
    metadata: list[tuple[str, dict[str, str]]] = []
    protocols: list[bytes] = []
    for path in paths:
        types: dict[int, Any] = {}
        channels: dict[int, Channel] = {}
        with path.open("rb") as file:
            for record in records(file):
                match record:
                    case Schema():
                        pool = descriptor_pool.DescriptorPool()
                        for one in descriptor_pb2.FileDescriptorSet.FromString(record.data).file:
                            pool.Add(one)
                        types[record.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(record.name))
                    case Channel():
                        channels[record.id] = record
                    case Message():
                        channel = channels[record.channel_id]
                        messages.append((channel.topic, types[channel.schema_id].FromString(record.data)))
                    case Metadata():
                        metadata.append((record.name, dict(record.metadata)))
                    case Attachment() if record.name == "protocol.toml":
                        protocols.append(record.data)
    plan = next((message for topic, message in messages if topic == "/session/plan"), None)
    return messages, metadata, protocols[0] if protocols else plan.protocol_toml


def records(file: Any) -> Iterator[Any]:
    """The records of a log; of one that was cut off, those that are whole."""
    try:
        yield from StreamReader(file).records
    except (McapError, EOFError, struct.error):
        return


def read_sessions(study: Path) -> list["Session"]:
    """Every session, in order of path: its finished log, and behind it the segments that were cut off."""
    files: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    for path in sorted(study.rglob("*.mcap*")):
        if path.name.endswith((".mcap", ".mcap.part")):
            files[path.parent, path.name.partition(".")[0].partition("_seg-")[0]].append(path)
    return [read_session(sorted(paths, key=lambda path: "_seg-" in path.name)) for _, paths in sorted(files.items())]


def read_session(paths: Sequence[Path]) -> "Session":
    path = paths[0]
    messages, metadata, protocol = read_messages(paths)
    starts = [values for name, values in metadata if name == "minihuman.segment"]
    plan = next(message for topic, message in messages if topic == "/session/plan")
    episodes: list[Episode] = []
    current: Episode | None = None
    segment, offset_ns, last_ns, skipped, end_reason = 0, 0, 0, 0, "cut_off"
    paused: int | None = None
    pauses: dict[int, list[tuple[int, int]]] = defaultdict(list)
    attempts: Counter[int] = Counter()
    answers: list[tuple[int, int, Any]] = []
    pictures: list[tuple[Episode, Any]] = []
    sounds: list[tuple[Episode, Any]] = []
    trial_responses: list[tuple[Episode, Any]] = []
    keys: list[tuple[int, Any]] = []
    notes: list[Any] = []
    offsets: list[int] = []
    for topic, message in messages:
        if topic == "/session/plan":
            if paused is not None:
                pauses[segment].append((paused, max(paused, last_ns)))
            after_ns = last_ns + 1 if segment else 0
            zero = int(starts[0]["started_unix_ns"])
            offset_ns = max(int(starts[segment]["started_unix_ns"]) - zero, after_ns)
            segment, current, paused, end_reason = segment + 1, None, None, "cut_off"
            last_ns = offset_ns
            offsets.append(offset_ns)
        if hasattr(message, "t_ns"):
            last_ns = max(last_ns, message.t_ns + offset_ns)
        match topic:
            case "/episode/start":
                attempts[message.plan.episode] += 1
                current = Episode(message, segment, offset_ns, attempts[message.plan.episode])
                episodes.append(current)
            case "/step" if current is not None:
                current.steps.append(message)
            case "/input/key":
                keys.append((segment, message))
                if current is not None:
                    current.keys.append(message)
            case "/frame":  # the last picture may come to the display after the end
                episodes[-1].frames.append(message)
            case "/episode/end" if current is not None:
                current.outcome, current.last_ns, current = message.outcome, message.t_ns, None
            case "/episode/skip":
                skipped += message.count
            case "/session/note":
                notes.append(message)
            case "/trial" if current is not None:
                current.trial = message
            case "/trial/stimuli":
                pictures.append((episodes[-1], message))
            case "/trial/sound":
                sounds.append((episodes[-1], message))
            case "/trial/response":
                trial_responses.append((episodes[-1], message))
            case "/answer":
                answers.append((segment, offset_ns, message))
            case "/session/pause":
                if message.paused and paused is None:
                    paused = message.t_ns + offset_ns
                elif not message.paused and paused is not None:
                    pauses[segment].append((paused, message.t_ns + offset_ns))
                    paused = None
            case "/session/end":
                end_reason = message.reason
        if current is not None and hasattr(message, "t_ns"):
            current.last_ns = message.t_ns
    if paused is not None:
        pauses[segment].append((paused, max(paused, last_ns)))
    for episode in episodes:
        episode.pauses = pauses[episode.segment]
    return Session(
        path, plan, tomllib.loads(protocol.decode()), metadata, episodes, segment, end_reason, skipped,
        read_tags(path), answers, pictures, sounds, trial_responses, keys, notes,
        [pause for each in pauses.values() for pause in each], offsets,
    )  # fmt: skip


def read_tags(log: Path) -> dict[int | None, set[str]]:
    tags: dict[int | None, set[str]] = defaultdict(set)
    path = log.with_name(log.name.partition(".")[0].partition("_seg-")[0] + ".marks.jsonl")
    for line in path.read_text().splitlines() if path.exists() else ():
        mark = json.loads(line)
        its = tags[mark.get("episode")]
        (its.discard if mark.get("taken_back") else its.add)(mark["tag"])
    return tags


def responses(episode: Episode) -> list[float | None]:
    """Of each step the press minus the stimulus onset, ms; in real time of the first press after each named onset."""
    if episode.start.plan.pace != "real_time":
        return [step.rt_ms if step.HasField("rt_ms") else None for step in episode.steps]
    onsets = {0} if episode.start.onset else set()
    onsets |= {step.step for step in episode.steps if step.onset}
    flips: dict[int, int] = {}
    for frame in episode.frames:
        if frame.step in onsets:
            flips.setdefault(frame.step, frame.flip_ns)
    found: list[float | None] = []
    answered = set()
    for step in episode.steps:
        before = [flip_ns for flip_ns in flips.values() if flip_ns <= step.key_t_ns]
        value = None
        if step.key and (not before or max(before) not in answered):
            onset = max(before, default=None)
            answered.add(onset)
            span = (0 if onset is None else onset + episode.offset_ns, step.key_t_ns + episode.offset_ns)
            if onset is not None and not any(span[0] < end and begin < span[1] for begin, end in episode.pauses):
                value = (step.key_t_ns - onset) / 1e6
        found.append(value)
    return found


@cache
def fewest_steps(cells: frozenset[tuple[int, int]], goal: tuple[int, int], start: tuple[int, int, int]) -> int | None:
    """Turns and moves from a cell and heading to the goal over free cells."""
    ahead = ((1, 0), (0, -1), (-1, 0), (0, 1))  # counter-clockwise seen from above, rows down the page
    waiting, seen = deque([(start, 0)]), {start}
    while waiting:
        (x, z, heading), steps = waiting.popleft()
        if (x, z) == goal:
            return steps
        there = x + ahead[heading][0], z + ahead[heading][1]
        for state in (
            (x, z, (heading + 1) % 4),
            (x, z, (heading - 1) % 4),
            *([(*there, heading)] if there in cells else []),
        ):
            if state not in seen:
                seen.add(state)
                waiting.append((state, steps + 1))
    return None


def feasible_steps(episode: Episode) -> int | None:
    """The fewest steps to the goal on a grid's floor plan; None of other worlds, which the log does not tell."""
    floor = episode.start.map
    goal = next((thing for thing in floor.things if thing.name == "green goal"), None)
    if floor.unit != "cell" or goal is None:
        return None
    start = episode.start.pose
    walls = set()  # by the middle of a cell's side, in half cells
    for w in floor.walls:
        length = round(abs(w.x1 - w.x0) + abs(w.z1 - w.z0))
        for at in range(length):
            share = (at + 0.5) / length
            walls.add((round(2 * (w.x0 + share * (w.x1 - w.x0))), round(2 * (w.z0 + share * (w.z1 - w.z0)))))
    lava = {(round(thing.x), round(thing.z)) for thing in floor.things if thing.name == "lava"}
    cells, waiting = {(round(start.x), round(start.z))}, deque([(round(start.x), round(start.z))])
    while waiting:  # what can be walked to
        x, z = waiting.popleft()
        for dx, dz in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            there = x + dx, z + dz
            if there not in cells | lava and (2 * x + dx, 2 * z + dz) not in walls:
                cells.add(there)
                waiting.append(there)
    heading = round(start.yaw_rad / (math.pi / 2)) % 4
    return fewest_steps(frozenset(cells), (round(goal.x), round(goal.z)), (round(start.x), round(start.z), heading))


def path_rows(episode: Episode, feasible: int | None) -> Row:
    """The measures that stand the steps beside the fewest."""
    steps, limit, outcome = len(episode.steps), episode.start.plan.max_steps, episode.outcome
    if feasible is None or outcome not in ("goal", "timeout", "failure"):
        return {"excess_steps": None, "log_excess_steps": None, "log_steps_ratio": None, "spl": None}
    taken = steps if outcome == "goal" else limit
    return {
        "excess_steps": float(steps - feasible) if outcome == "goal" else None,
        "log_excess_steps": math.log1p(max(taken - feasible, 0)),
        "log_steps_ratio": math.log(max(taken, feasible) / feasible) if feasible else None,
        "spl": feasible / max(steps, feasible) if outcome == "goal" and steps else 0.0,
    }


def answer_rows(session: Session) -> Iterator[Row]:
    for segment, offset_ns, one in session.answers:
        value = json.loads(one.value)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        told = value if isinstance(value, str) or value is None else json.dumps(value, ensure_ascii=False)
        yield {
            **session.who,
            "segment": segment,
            "part": one.part + 1,
            "questions": one.part_name,
            "item": one.item,
            "kind": one.kind,
            "attempt": one.attempt,
            "t_ns": one.t_ns + offset_ns,
            "answer": told,
            "number": float(value) if is_number else None,
            "said": one.words or None,
            "right": one.right if one.HasField("right") else None,
            "shown_ns": one.shown_ns + offset_ns if one.shown_ns else None,
            "first_ms": (one.first_ns - one.shown_ns) / 1e6 if one.first_ns and one.shown_ns else None,
            "answer_ms": (one.t_ns - one.shown_ns) / 1e6 if one.shown_ns else None,
            "changes": one.changes,
        }


def trial_place(session: Session, episode: Episode, message: Any) -> Row:
    """What the rows of trials with a time course have in common."""
    if message.episode + 1 != episode.number:
        raise ValueError(f"{session.path.name}: episode {message.episode + 1} while {episode.number} was played")
    return {
        **session.who,
        "segment": episode.segment,
        "t_ns": message.t_ns + episode.offset_ns,
        "part": message.part + 1,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def picture_rows(session: Session) -> Iterator[Row]:
    """Each picture of a trial: its stimuli and when it was to be there, by the trial's times and its first flip."""
    starts: dict[tuple[int, int], int] = {}
    firsts: dict[tuple[int, int], int] = {}
    seen: set[tuple[int, int, int]] = set()
    for episode, picture in session.pictures:
        key = episode.number, episode.attempt
        if picture.frame < 0:  # the empty one, so long before the first, where a sound needs it
            starts.setdefault(key, picture.flip_ns + 150_000_000)
            continue
        schedule = json.loads(episode.trial.schedule_json)
        due_ns = episode.trial.start_ns or starts.get(key)
        if picture.frame:
            due_ns = firsts[key] + change_times(schedule)[picture.frame]
        if (*key, picture.frame) in seen:  # what remains after a response is shown at once
            due_ns = None
        seen.add((*key, picture.frame))
        firsts.setdefault(key, picture.flip_ns)
        yield {
            **trial_place(session, episode, picture),
            "picture": picture.frame + 1,
            "stimuli": json.dumps(visible_names(session, episode, picture), ensure_ascii=False),
            "due_ns": None if due_ns is None else due_ns + episode.offset_ns,
            "flip_ns": picture.flip_ns + episode.offset_ns,
            "late_ms": None if due_ns is None else (picture.flip_ns - due_ns) / 1e6,
        }


def sound_rows(session: Session) -> Iterator[Row]:
    """Each sound of a trial: when it was to begin, by the trial's times and its first flip, and when it did, if so."""
    for episode in session.episodes:
        if episode.trial is None:
            continue
        rows = [*played_sounds(session, episode), *missing_sounds(session, episode)]
        yield from sorted(rows, key=lambda row: row["t_ns"])


def played_sounds(session: Session, episode: Episode) -> Iterator[Row]:
    schedule = json.loads(episode.trial.schedule_json)
    for sound in (one for its, one in session.sounds if its is episode):
        onset_ns = next((one["onset_ns"] for one in schedule["sounds"] if one["name"] == sound.sound), 0)
        first_ns = next(one.flip_ns for its, one in session.pictures if its is episode and one.frame == 0)
        if sound.sound == "feedback":
            first_ns = episode.steps[-1].t_ns
        yield {
            **trial_place(session, episode, sound),
            "sound": sound.sound,
            "due_ns": first_ns + onset_ns + episode.offset_ns,
            "scheduled_ns": sound.scheduled_ns + episode.offset_ns,
            "onset_ns": sound.onset_ns + episode.offset_ns,
            "late_ms": (sound.onset_ns - first_ns - onset_ns) / 1e6,
            "uncertainty_ms": sound.uncertainty_ms,
        }


def missing_sounds(session: Session, episode: Episode) -> Iterator[Row]:
    """The sounds that were due before the trial was over, with no word of their onset; a response removes some."""
    schedule = json.loads(episode.trial.schedule_json)
    heard = {one.sound for its, one in session.sounds if its is episode}
    end_ns = episode.steps[-1].t_ns if episode.steps else episode.last_ns
    first_ns = next((one.flip_ns for its, one in session.pictures if its is episode and one.frame == 0), None)
    answers = [one.t_ns for its, one in session.trial_responses if its is episode]
    due = {}
    for one in schedule.get("sounds", ()) if first_ns is not None else ():
        due_ns = first_ns + one["onset_ns"]
        if due_ns < end_ns and not (one["until_response"] and answers and min(answers) <= due_ns):
            due[one["name"]] = due_ns
    if episode.outcome in schedule.get("feedback", {}):
        due["feedback"] = end_ns
    unknown = dict.fromkeys(("scheduled_ns", "onset_ns", "late_ms", "uncertainty_ms"))
    for name, due_ns in due.items():
        if name not in heard:
            place = trial_place(session, episode, episode.trial)
            moment = due_ns + episode.offset_ns
            yield {**place, "t_ns": moment, "sound": name, "due_ns": moment, **unknown}


def change_times(schedule: Mapping[str, Any]) -> list[int]:
    """The times since a trial's first picture at which what is visible changes, or the target begins."""
    spans = [(one["onset_ns"], one["end_ns"] or math.inf, one["name"]) for one in schedule["stimuli"]]
    last_ns = schedule["end_ns"] or math.inf
    times = sorted({0, *(time for begin, end, _ in spans for time in (begin, end) if time < last_ns)})
    kept, before = [], None
    for time in times:
        visible = {name for begin, end, name in spans if begin <= time < end}
        if not kept or visible != before or time == schedule["target_ns"]:
            kept.append(time)
            before = visible
    return kept


def visible_names(session: Session, episode: Episode, picture: Any) -> list[str]:
    """The names of a picture's stimuli, the front one last; a response removes those that stay until it."""
    schedule = json.loads(episode.trial.schedule_json)
    time = change_times(schedule)[picture.frame]
    answered = any(one is episode and taken.t_ns < picture.t_ns for one, taken in session.trial_responses)
    visible = [
        one
        for one in schedule["stimuli"]
        if one["onset_ns"] <= time < (one["end_ns"] or math.inf) and not (answered and one["until_response"])
    ]
    return [one["name"] for one in sorted(visible, key=lambda one: one["layer"])]


def trial_response_rows(session: Session) -> Iterator[Row]:
    """Each response of a trial, timed from the flip of the picture in which its target begins, or from its sound."""
    numbers: Counter[tuple[int, int]] = Counter()
    for episode, taken in session.trial_responses:
        schedule = json.loads(episode.trial.schedule_json)
        heard = [one for its, one in session.sounds if its is episode and one.sound == schedule["target"]]
        if heard:
            onset_ns = heard[0].onset_ns
        else:
            target = change_times(schedule).index(schedule["target_ns"])
            onset_ns = next(one.flip_ns for its, one in session.pictures if its is episode and one.frame == target)
        numbers[episode.number, episode.attempt] += 1
        yield {
            **trial_place(session, episode, taken),
            "number": numbers[episode.number, episode.attempt],
            "key": key_name(taken.key),
            "pressed_ns": taken.pressed_ns + episode.offset_ns,
            "response_ms": (taken.pressed_ns - onset_ns) / 1e6,
        }


def key_name(key: str) -> str | None:
    return f"key_{key}" if len(key) == 1 else key or None


def place(episode: Episode) -> Row:
    return {
        "block": episode.block,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def step_rows(session: Session, episode: Episode) -> Iterator[Row]:
    names = episode.start.action_names
    for step, shows, response in zip(episode.steps, episode.visible(), responses(episode), strict=True):
        t_ns = step.t_ns + episode.offset_ns
        pose = step.pose if step.HasField("pose") else None
        yield {
            **session.who,
            **place(episode),
            "step": step.step,
            "t_ns": t_ns,
            "t_s": t_ns / 1e9,
            "action": names[step.action],
            "key": key_name(step.key),
            "reward": step.reward,
            "reaction_ms": step.rt_ms if step.HasField("rt_ms") else None,
            "response_ms": response,
            "visible_effect": shows,
            "x": pose and pose.x,
            "y": pose and pose.y,
            "z": pose and pose.z,
            "unit": episode.start.map.unit or None,
            "yaw_rad": pose and pose.yaw_rad,
            "terminated": step.terminated,
            "truncated": step.truncated,
        }


def press_rows(session: Session, episode: Episode) -> Iterator[Row]:
    for key in episode.keys:
        t_ns = key.t_ns + episode.offset_ns
        yield {
            **session.who,
            **place(episode),
            "t_ns": t_ns,
            "t_s": t_ns / 1e9,
            "key": key_name(key.key),
            "down": key.down,
            "action": episode.start.action_names[key.action] if key.HasField("action") else None,
            "verdict": key.verdict,
        }


def pressed(episode: Episode) -> list[Any]:
    return [key for key in episode.keys if key.down and key.verdict != "repeat"]


def refused(episode: Episode) -> list[Any]:
    return [key for key in pressed(episode) if key.verdict not in ("accepted", "queued")]


def by_key_map(episodes: Sequence[Episode]) -> list[list[Episode]]:
    """Episodes that follow each other under one key map."""
    runs: list[list[Episode]] = []
    for episode in episodes:
        if runs and runs[-1][0].key_map() == episode.key_map():
            runs[-1].append(episode)
        else:
            runs.append([episode])
    return runs


def discoveries(run: Sequence[Episode]) -> dict[str, tuple[float, int]]:
    """Playing time and steps until each key first changed what is seen."""
    found: dict[str, tuple[float, int]] = {}
    before_ns = done = 0
    for episode in run:
        for number, (step, shows) in enumerate(zip(episode.steps, episode.visible(), strict=True)):
            if shows and step.key not in found:
                since_ns = before_ns + episode.played_ns(step.key_t_ns + episode.offset_ns)
                found[step.key] = since_ns / 1e9, done + number + 1
        before_ns += episode.played_ns()
        done += len(episode.steps)
    return found


def key_rows(session: Session) -> Iterator[Row]:
    for run in by_key_map(session.episodes):
        its = run[0].start.plan.key_map
        actions = {one.key: one.action for one in its.keys}
        presses = Counter(key.key for episode in run for key in pressed(episode))
        not_taken = Counter(key.key for episode in run for key in refused(episode))
        steps: Counter[str] = Counter()
        ineffective: Counter[str] = Counter()
        for episode in run:
            for step, shows in zip(episode.steps, episode.visible(), strict=True):
                steps[step.key] += 1
                ineffective[step.key] += not shows
        found = discoveries(run)
        others = {*its.spare_keys, *presses, *(key for key, count in steps.items() if count)} - {*actions, ""}
        for key in (*sorted(actions), *sorted(others)):
            seconds, count = found.get(key, (None, None)) if key in actions else (None, None)
            yield {
                **session.who,
                "block": run[0].block,
                "first_episode": run[0].number,
                "key": key_name(key),
                "action": actions.get(key),
                "presses": presses[key],
                "steps": steps[key],
                "ineffective_steps": ineffective[key],
                "refused": not_taken[key],
                "discovered_s": seconds,
                "discovered_steps": count,
            }


def path_row(episode: Episode) -> Row:
    """Ground covered, straightness, and runs of turning on the spot."""
    poses = [one.pose if one.HasField("pose") else None for one in (episode.start, *episode.steps)]
    if any(pose is None for pose in poses):
        return {"path_length": None, "path_efficiency": None, "turns_in_place": None}
    length, turns, is_turning = 0.0, 0, False
    for before, after in pairwise(poses):
        stride = math.hypot(after.x - before.x, after.z - before.z)
        length += stride
        if stride >= NOISE:
            is_turning = False
        elif abs(math.remainder(after.yaw_rad - before.yaw_rad, math.tau)) > NOISE and not is_turning:
            is_turning = True
            turns += 1
    straight = math.hypot(poses[-1].x - poses[0].x, poses[-1].z - poses[0].z)
    efficiency = straight / length if length > NOISE else None
    return {"path_length": length, "path_efficiency": efficiency, "turns_in_place": turns}


def episode_row(episode: Episode, told: int | None = None) -> Row:
    plan, times = episode.start.plan, [step.rt_ms for step in episode.steps if step.HasField("rt_ms")]
    answered = [one for one in responses(episode) if one is not None]
    feasible = feasible_steps(episode) if told is None else told
    return {
        **place(episode),
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "seed": plan.seed,
        "t_ns": episode.start_ns,
        "outcome": episode.outcome,
        "success": episode.outcome == "goal",
        "reward": sum((step.reward for step in episode.steps), 0.0),
        "steps": len(episode.steps),
        "max_steps": plan.max_steps,
        "playing_s": episode.played_ns() / 1e9,
        "reaction_mean_ms": statistics.fmean(times) if times else None,
        "reaction_median_ms": statistics.median(times) if times else None,
        "response_mean_ms": statistics.fmean(answered) if answered else None,
        "response_median_ms": statistics.median(answered) if answered else None,
        "feasible_steps": feasible,
        **path_rows(episode, feasible),
        **path_row(episode),
        "unit": episode.start.map.unit or None,
        "ineffective_steps": episode.visible().count(False),
        "refused": len(refused(episode)),
        "absent_share": None,
        "info_at_end": (episode.steps[-1].info_json or None) if episode.steps else None,
    }


def label_cells(episode: Episode) -> Row:
    """The cells of an episode's labels, each a column of the files."""
    labels = json.loads(episode.start.plan.labels_json or "{}")
    return {f"label_{name}": read_label(label) for name, label in labels.items()}


def read_label(label: str | int | float | bool) -> str | float | bool | None:
    """A label as a cell has it: numbers of one kind, nothing for an empty text."""
    if isinstance(label, bool | str):
        return label or None
    return float(label)


def mean(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return statistics.fmean(there) if there else None


def slope(rows: Sequence[Row]) -> float | None:
    """Least squares over the first five episodes of a block; None of several blocks."""
    points = [(row["episode_in_block"] - 1, row["reward"]) for row in rows]
    points = [(x, y) for x, y in dict(points).items() if x < FIRST_EPISODES]
    if len({row["block"] for row in rows}) != 1 or len(points) < 2:
        return None
    mean_x, mean_y = (statistics.fmean(axis) for axis in zip(*points, strict=True))
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / sum((x - mean_x) ** 2 for x, _ in points)


def over(session: Session, rows: Sequence[Row], episodes: Sequence[Episode]) -> Row:
    """What some episodes amount to; keys are found in all that were begun in their blocks."""
    rewards = [row["reward"] for row in rows]
    times = [step.rt_ms for episode in episodes for step in episode.steps if step.HasField("rt_ms")]
    answered = [one for episode in episodes for one in responses(episode) if one is not None]
    blocks = {row["block"] for row in rows}
    runs = by_key_map([episode for episode in session.episodes if episode.block in blocks])
    to_find = [discoveries(run).get(one.key) for run in runs for one in run[0].start.plan.key_map.keys]
    found = [one[0] for one in to_find if one is not None]
    steps = sum(row["steps"] for row in rows)
    return {
        "episodes": len(rows),
        "success": mean([row["success"] for row in rows]),
        "reward_mean": mean(rewards),
        "reward_sd": statistics.stdev(rewards) if len(rewards) > 1 else None,
        "reward_first": rewards[0] if rewards else None,
        "reward_slope": slope(rows),
        "steps_mean": mean([row["steps"] for row in rows]),
        "steps_at_limit_mean": mean([row["steps"] if row["success"] else row["max_steps"] for row in rows]),
        "playing_s_mean": mean([row["playing_s"] for row in rows]),
        "reaction_median_ms": statistics.median(times) if times else None,
        "response_median_ms": statistics.median(answered) if answered else None,
        **{
            f"{name}_mean": mean([row[name] for row in rows])
            for name in ("excess_steps", "log_excess_steps", "log_steps_ratio", "spl")
        },
        "path_efficiency_mean": mean([row["path_efficiency"] for row in rows]),
        "ineffective_share": sum(row["ineffective_steps"] for row in rows) / steps if steps else None,
        "refused": sum(row["refused"] for row in rows),
        "keys_discovered": len(found),
        "keys_total": len(to_find),
        "all_keys_discovered_s": max(found) if found and len(found) == len(to_find) else None,
    }


def session_row(session: Session) -> Row:
    completed = {one.number for one in session.episodes if one.outcome not in ("abandoned", "cut_off")}
    planned = len(session.plan.episodes) - session.skipped
    facts, ends = session.facts("facts"), session.facts("end")
    return {
        "player": facts[0].get("player"),
        "window": facts[0].get("window"),
        "started_at": session.facts("segment")[0]["started_at"],
        "utc_offset_min": int(facts[0]["utc_offset_min"]) if "utc_offset_min" in facts[0] else None,
        "end_reason": session.end_reason,
        "clean": len(ends) == session.segments and all(end["clean"] == "true" for end in ends),
        "segments": session.segments,
        "completed_share": len(completed) / planned if planned else None,
    }


def broken_rule(session: Session, level: str, row: Row) -> str | None:
    for rule in session.protocol.get("exclusions", []):
        value = row.get(rule["measure"])
        if rule.get("level", "episode") != level or value is None:
            continue
        if value < rule.get("below", -math.inf) or value > rule.get("above", math.inf):
            return str(rule["reason"])
    return None


def reasons(session: Session, rows: Sequence[Row]) -> list[str | None]:
    """Why each episode is left out; None where nothing speaks against it."""
    found = []
    for row in rows:
        tags = session.tags[row["episode"]] | session.tags[None]
        if "exclude" in tags:
            found.append("tagged exclude")
        elif row["outcome"] in ("abandoned", "cut_off"):
            found.append("not played to an end")
        else:
            found.append(broken_rule(session, "episode", row))
    return found


def included(session: Session, rows: Sequence[Row], why: Sequence[str | None], *, analysed: bool) -> list[int]:
    practice = session.practice() if analysed else set()
    return [at for at, row in enumerate(rows) if why[at] is None and row["block"] not in practice]


Place = tuple[str, int, int, int]  # participant, session, episode, attempt


def recompute(sessions: Sequence[Session], told: Mapping[Place, int] | None = None) -> dict[str, list[Row]]:
    """The rows of each table, of all sessions in order of path.

    Args:
        sessions: as they were read.
        told: the fewest steps of episodes whose world alone tells them.
    """
    told = told or {}
    against: dict[str, list[tuple[int, str]]] = defaultdict(list)
    measured = {
        id(session): [
            episode_row(one, told.get((session.who["participant"], session.plan.session, one.number, one.attempt)))
            for one in session.episodes
        ]
        for session in sessions
    }
    for session in sessions:
        rows = measured[id(session)]
        its = included(session, rows, reasons(session, rows), analysed=True)
        row = over(session, [rows[at] for at in its], [session.episodes[at] for at in its]) | session_row(session)
        if why := broken_rule(session, "participant", row):
            against[session.who["participant"]].append((session.plan.session, why))
    tables: dict[str, list[Row]] = {name: [] for name in TABLES}
    no_label = dict.fromkeys(name for session in sessions for one in session.episodes for name in label_cells(one))
    for session in sessions:
        who = session.who
        of_person = min(against[who["participant"]], default=(0, None))[1]
        rows = measured[id(session)]
        why = reasons(session, rows)
        for episode, row, reason in zip(session.episodes, rows, why, strict=True):
            tables["steps"] += step_rows(session, episode)
            tables["presses"] += press_rows(session, episode)
            tags = " ".join(sorted(session.tags[episode.number] | session.tags[None])) or None
            row = who | row | no_label | label_cells(episode)
            tables["episodes"].append(row | {"tags": tags, "exclusion_reason": of_person or reason})
        tables["keys"] += key_rows(session)
        tables["answers"] += answer_rows(session)
        tables["trial_stimuli"] += picture_rows(session)
        tables["trial_sounds"] += sound_rows(session)
        tables["trial_responses"] += trial_response_rows(session)
        for block in dict.fromkeys(row["block"] for row in rows):
            its = [at for at in included(session, rows, why, analysed=False) if rows[at]["block"] == block]
            row = over(session, [rows[at] for at in its], [session.episodes[at] for at in its])
            reason = of_person or (None if its else "no episode counts")
            tables["blocks"].append(who | {"block": block} | row | {"exclusion_reason": reason})
        its = included(session, rows, why, analysed=True)
        row = over(session, [rows[at] for at in its], [session.episodes[at] for at in its])
        counts = bool(included(session, rows, why, analysed=False)) or not session.plan.episodes
        reason = of_person or (None if counts else "no episode counts")
        tables["participants"].append(who | session_row(session) | row | {"exclusion_reason": reason})
    return tables


def equal(cell: Any, value: Any) -> bool:
    """Whether a cell, of a CSV or typed, holds a value: texts and counts exactly, others to a double's last digits."""
    if value is None:
        return cell is None or cell == "" or cell != cell
    if cell is None or cell != cell:
        return False
    if isinstance(value, bool):
        return str(cell).upper() == str(value).upper() or cell == value
    if isinstance(value, float):
        return cell != "" and math.isclose(float(cell), value, rel_tol=1e-12, abs_tol=1e-12)
    return str(cell) == str(value)


@dataclass
class Tally:
    """How many numbers and words of an output were compared, and each that is not what the logs say."""

    compared: int = 0
    wrong: list[str] = field(default_factory=list)

    def same(self, where: str, found: Any, expected: Any) -> None:
        self.compared += 1
        if not equal(found, expected):
            self.wrong.append(f"{where}: {found!r}; by the logs {expected!r}")

    def rows(
        self,
        where: str,
        found: Sequence[Row],
        expected: Sequence[Row],
        *,
        without: Collection[str] = (),
        is_whole: bool = False,
    ) -> None:
        """Compare the rows of a table, column by column; of a whole table, no column may be unknown."""
        self.same(f"{where}, rows", len(found), len(expected))
        for number, (cells, row) in enumerate(zip(found, expected, strict=False), 1):
            if missing := row.keys() - cells.keys() - set(without):
                self.wrong.append(f"{where} has no columns {sorted(missing)}")
                return
            if is_whole and (unknown := cells.keys() - row.keys() - NOT_RECOMPUTED):
                self.wrong.append(
                    f"{where} has columns {sorted(unknown)}, which tests/recompute/tables.py does not compute; compute "
                    "them there from the log, or add them to NOT_RECOMPUTED with the reason"
                )
                return
            for column, value in row.items():
                if column not in without:
                    self.same(f"{where} row {number} {column}", cells[column], value)


NOT_RECOMPUTED = frozenset(  # columns that are not computed here
    {
        "action_vector",  # of worlds whose actions are vectors, which no study here has
        "info",  # what a world says beside its observations, as text: no study here records it
        "labels",  # text of the protocol, copied
        "shortest_steps",  # the fewest steps to the goal, which only the world itself can tell: taken as given
        "evidence",  # a word about how the session was recorded, no number
        "clock_notes",  # a count of notes whose texts are the recorder's
        "page_alterations",  # the texts of such notes
    }
)


NEEDING_WORLD = frozenset(
    {"shortest_steps", "feasible_steps", "excess_steps", "log_excess_steps", "log_steps_ratio", "spl"}
    | {"excess_steps_mean", "log_excess_steps_mean", "log_steps_ratio_mean", "spl_mean"}
)


def read_csv(path: Path) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_told(episodes: Sequence[Row]) -> dict[Place, int]:
    """The fewest steps of first-person worlds, which no log tells, as a table of episodes has them."""
    return {
        (row["participant"], int(row["session"]), int(row["episode"]), int(row["attempt"])): int(row["feasible_steps"])
        for row in episodes
        if "MiniWorld" in row["world"] and row["feasible_steps"] not in (None, "")
    }
