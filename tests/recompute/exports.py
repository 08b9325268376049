"""A study's exports and answers compared with its logs: CSV, Parquet, SQL, notebooks, Minari, LeRobot, BIDS."""

import csv
import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from tests.recompute.tables import (
    NEEDING_WORLD,
    TABLES,
    Episode,
    Row,
    Session,
    Tally,
    key_name,
    read_csv,
    responses,
)

QUERIES = {  # file: SQL, and what the same is by the rows of the tables
    "outcomes": 'select "group", outcome, count(*) n, sum(steps) steps from episodes where exclusion_reason is null '
    "group by all order by all",
    "rewards": "select participant, session, avg(reward) reward, stddev_samp(playing_s) sd from episodes "
    "where exclusion_reason is null group by all order by all",
    "excluded": "select exclusion_reason, count(*) n from episodes group by all order by 2, 1",
    "reactions": "select block, count(response_ms) n, median(response_ms) ms, max(s.t_ns) last from steps s "
    "join episodes e using (participant, session, episode, attempt, block) where e.exclusion_reason is null "
    "group by all order by all",
    "presses": "select participant, verdict, count(*) n from presses where down group by all order by all",
}


def included(session: Session, rows: Sequence[Row]) -> list[tuple[Episode, Row]]:
    """A session's episodes that count, each with its row."""
    its = [
        row
        for row in rows
        if (row["participant"], row["session"]) == (session.who["participant"], session.plan.session)
    ]
    return [(one, row) for one, row in zip(session.episodes, its, strict=True) if row["exclusion_reason"] is None]


def facts(session: Session, episode: Episode) -> Row:
    """What stands beside an episode in an export."""
    plan = episode.start.plan
    return {
        **session.who,
        "player": session.facts("facts")[0].get("player"),
        "block": episode.block,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
        "world": plan.world,
        "seed": plan.seed,
        "outcome": episode.outcome,
        "mission": episode.start.mission,
        "key_map": {one.key: one.action for one in plan.key_map.keys},
        "action_names": list(episode.start.action_names),
        "protocol_sha256": session.plan.protocol_sha256,
    }


def pose_row(pose: Any) -> list[float]:
    return [pose.x, pose.y, pose.z, pose.yaw_rad]


def times(episode: Episode) -> list[int]:
    return [episode.start_ns, *(step.t_ns + episode.offset_ns for step in episode.steps)]


class Logs:
    """A study's sessions and the rows recomputed from them."""

    def __init__(self, sessions: Sequence[Session], tables: Mapping[str, list[Row]]) -> None:
        self.sessions, self.tables = sessions, tables
        self.included = [
            (session, episode, row) for session in sessions for episode, row in included(session, tables["episodes"])
        ]

    def played(self) -> dict[tuple[str, int, int, int], tuple[Session, Episode]]:
        """The included episodes with a step, by participant, session, episode and attempt."""
        return {
            (one.who["participant"], one.plan.session, episode.number, episode.attempt): (one, episode)
            for one, episode, _ in self.included
            if episode.steps
        }


def compare_tables(logs: Logs, folder: Path, tally: Tally) -> None:
    """CSV or Parquet files of all tables, with the columns that no world is asked for."""
    for name in TABLES:
        path, other = folder / f"{name}.csv", folder / f"{name}.parquet"  # no file where there is no row
        rows = read_csv(path) if path.exists() else read_parquet(other) if other.exists() else []
        tally.rows(f"{folder.name} {name}", rows, logs.tables[name], without=NEEDING_WORLD, is_whole=True)


def read_parquet(path: Path) -> list[Row]:
    """The rows of a Parquet file, times of the wall clock as the log writes them; they have whole microseconds."""
    rows: list[Row] = pq.read_table(path).to_pylist()
    for row in rows:
        for column, cell in row.items():
            if isinstance(cell, datetime):
                row[column] = f"{cell:%Y-%m-%dT%H:%M:%S.%f}000Z"
    return rows


def account(logs: Logs) -> Iterator[str]:
    """What is included, and what is excluded and why, in the words of the command line."""
    rows, people = logs.tables["episodes"], logs.tables["participants"]
    by_rule = {
        (row["participant"], row["exclusion_reason"])
        for row in people
        if row["exclusion_reason"] not in (None, "no episode counts")
    }
    codes = {code for code, _ in by_rule}
    sessions = sum(row["exclusion_reason"] is None for row in people)
    yield f"{plural(len(logs.included), 'episode')} of {plural(sessions, 'session')} included"
    episodes = Counter(
        row["exclusion_reason"] for row in rows if row["exclusion_reason"] and row["participant"] not in codes
    )
    for reason, count in episodes.items():
        yield f"excluded: {plural(count, 'episode')}: {reason}"
    for reason, count in Counter(reason for _, reason in by_rule).items():
        yield f"excluded: {plural(count, 'participant')}: {reason}"


def plural(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def compare_queries(logs: Logs, folder: Path, tally: Tally) -> None:
    """SQL over the tables: every row of the episodes, and aggregates."""
    tally.rows("query episodes", read_csv(folder / "episodes.csv"), logs.tables["episodes"])
    tally.rows("query participants", read_csv(folder / "participants.csv"), logs.tables["participants"])
    for name, rows in answers(logs).items():
        found = read_csv(folder / f"{name}.csv")
        tally.rows(f"query {name}", found, rows)


def answers(logs: Logs) -> dict[str, list[Row]]:
    """What the queries answer, by the rows."""
    counted = [row for row in logs.tables["episodes"] if row["exclusion_reason"] is None]
    outcomes: dict[tuple[str, str], list[Row]] = defaultdict(list)
    rewards: dict[tuple[str, int], list[Row]] = defaultdict(list)
    for row in counted:
        outcomes[row["group"], row["outcome"]].append(row)
        rewards[row["participant"], row["session"]].append(row)
    reasons = Counter(row["exclusion_reason"] for row in logs.tables["episodes"])
    reactions: dict[str, list[Row]] = defaultdict(list)
    places = {(row["participant"], row["session"], row["episode"], row["attempt"]) for row in counted}
    for row in logs.tables["steps"]:
        if (row["participant"], row["session"], row["episode"], row["attempt"]) in places:
            reactions[row["block"]].append(row)
    presses = Counter((row["participant"], row["verdict"]) for row in logs.tables["presses"] if row["down"])

    def known(rows: Sequence[Row]) -> list[float]:
        return [row["response_ms"] for row in rows if row["response_ms"] is not None]

    def spread(rows: Sequence[Row]) -> float | None:
        return float(np.std([row["playing_s"] for row in rows], ddof=1)) if len(rows) > 1 else None

    return {
        "outcomes": [
            {"group": group, "outcome": outcome, "n": len(rows), "steps": sum(row["steps"] for row in rows)}
            for (group, outcome), rows in sorted(outcomes.items())
        ],
        "rewards": [
            {
                "participant": code,
                "session": session,
                "reward": float(np.mean([row["reward"] for row in rows])),
                "sd": spread(rows),
            }
            for (code, session), rows in sorted(rewards.items())
        ],
        "excluded": [
            {"exclusion_reason": reason, "n": count}
            for reason, count in sorted(reasons.items(), key=lambda one: (one[1], one[0] is None, one[0] or ""))
        ],
        "reactions": [
            {
                "block": block,
                "n": len(known(rows)),
                "ms": float(np.median(known(rows))) if known(rows) else None,
                "last": max(row["t_ns"] for row in rows),
            }
            for block, rows in sorted(reactions.items())
        ],
        "presses": [
            {"participant": code, "verdict": verdict, "n": count} for (code, verdict), count in sorted(presses.items())
        ],
    }


def compare_notebook(logs: Logs, path: Path, tally: Tally) -> None:
    """What ``open_study`` gave, written down as JSON: sessions with all their episodes, and the account."""
    told = json.loads(path.read_text())
    tally.same("notebook, exclusions", sorted(told["exclusions"]), sorted(account(logs)))
    tally.same("notebook, sessions", len(told["sessions"]), len(logs.sessions))
    counted = {id(episode) for _, episode, _ in logs.included}
    rows = {
        (row["participant"], row["session"], row["episode"], row["attempt"]): row for row in logs.tables["episodes"]
    }
    for session, found in zip(logs.sessions, told["sessions"], strict=False):
        code, number = session.who["participant"], session.plan.session
        expected = {
            "participant": code,
            "group": session.who["group"],
            "number": number,
            "player": session.facts("facts")[0].get("player"),
            "started_at": session.facts("segment")[0]["started_at"],
            "end_reason": session.end_reason,
            "included": sum(id(one) in counted for one in session.episodes),
            "segments": session.segments,
        }
        tally.rows(f"notebook, {code} {number}", [found], [expected])
        tally.same(f"notebook, {code} {number}, episodes", len(found["episodes"]), len(session.episodes))
        for one, its in zip(session.episodes, found["episodes"], strict=False):
            row = rows[code, number, one.number, one.attempt]
            where = f"notebook, {code} {number} episode {one.number} attempt {one.attempt}"
            names = ("attempt", "block", "world", "seed", "outcome", "reward", "steps", "playing_s")
            expected = {"number": one.number, "exclusion": row["exclusion_reason"] or ""}
            expected |= {name: row[name] for name in names}
            tally.rows(where, [its], [expected])
            same_numbers(where, its["times_s"], [t_ns / 1e9 for t_ns in times(one)], tally)
            same_numbers(where, its["rewards"], [step.reward for step in one.steps], tally)
            reactions = [step.rt_ms if step.HasField("rt_ms") else math.nan for step in one.steps]
            same_numbers(where, [math.nan if ms is None else ms for ms in its["reaction_ms"]], reactions, tally)
            path = [pose_row(step.pose) for step in (one.start, *one.steps)]
            same_numbers(where, its["path"], path, tally)


def same_numbers(where: str, found: Any, expected: Any, tally: Tally) -> None:
    """Compare arrays, number by number."""
    ours, theirs = np.asarray(found), np.asarray(expected)
    tally.compared += theirs.size
    if ours.shape != theirs.shape:
        tally.wrong.append(f"{where}: shape {ours.shape}; by the logs {theirs.shape}")
    elif not np.allclose(ours, theirs, rtol=1e-12, atol=1e-12, equal_nan=True):
        tally.wrong.append(f"{where}: {ours.tolist()}; by the logs {theirs.tolist()}")


def compare_minari(logs: Logs, out: Path, tally: Tally) -> None:
    """Every episode of every dataset, and the totals."""
    import h5py

    played = logs.played()
    compare_readme_counts(played, out, tally)
    for path in sorted(out.rglob("main_data.hdf5")):
        with h5py.File(path) as file:
            metadata = json.loads((path.parent / "metadata.json").read_text())
            lengths = [int(file[name].attrs["total_steps"]) for name in file]
            tally.same(f"{path.parent.parent.name}, episodes", int(metadata["total_episodes"]), len(file))
            tally.same(f"{path.parent.parent.name}, steps", int(metadata["total_steps"]), sum(lengths))
            for name in file:
                group = file[name]
                its = dict(group.attrs)
                key = its["participant"], int(its["session"]), int(its["episode"]), int(its["attempt"])
                where = f"minari {path.parent.parent.name} {name} {key}"
                if key not in played:
                    tally.wrong.append(f"{where}: no included episode has steps there")
                    continue
                session, episode = played.pop(key)
                same_facts(where, its, facts(session, episode), tally)
                tally.same(where, int(its["total_steps"]), len(episode.steps))
                steps = episode.steps
                ended = [step.truncated for step in steps]
                ended[-1] = ended[-1] or not steps[-1].terminated
                for column, expected in (
                    ("actions", [step.action for step in steps]),
                    ("rewards", [step.reward for step in steps]),
                    ("terminations", [step.terminated for step in steps]),
                    ("truncations", ended),
                    ("infos/t_ns", times(episode)),
                    ("infos/pose", [pose_row(one.pose) for one in (episode.start, *steps)]),
                ):
                    same_numbers(f"{where} {column}", group[column][()], expected, tally)
    tally.wrong += [f"minari lacks {key}" for key in played]


def compare_readme_counts(played: Mapping[Any, tuple[Session, Episode]], out: Path, tally: Tally) -> None:
    text = (out / "README.md").read_text(encoding="utf-8")
    numbers = re.search(r"(\d+) episodes?, (\d+) steps?", text)
    steps = sum(len(episode.steps) for _, episode in played.values())
    tally.same(f"{out.name}, README", numbers and numbers.groups(), (str(len(played)), str(steps)))


def same_facts(where: str, found: Mapping[str, Any], expected: Row, tally: Tally) -> None:
    for name, value in expected.items():
        cell = found[name]
        if isinstance(value, dict | list):
            tally.same(f"{where} {name}", json.loads(cell) == value, True)
        else:
            tally.same(f"{where} {name}", cell, value)


def compare_lerobot(logs: Logs, out: Path, tally: Tally) -> None:
    """Every frame of every dataset, its episodes' facts, and the statistics of rewards and times."""
    played = logs.played()
    compare_readme_counts(played, out, tally)
    for info_path in sorted(out.glob("*/meta/info.json")):
        root = info_path.parents[1]
        info, statistics = (json.loads((root / "meta" / f"{name}.json").read_text()) for name in ("info", "stats"))
        frames = [
            row
            for path in sorted(root.glob("data/*/*.parquet"))
            for row in pq.read_table(
                path,
                columns=["action", "discrete_action", "next.reward", "next.done", "next.success", "time_s", "index"],
            ).to_pylist()
        ]
        episodes = [
            row for path in sorted(root.glob("meta/episodes/*/*.parquet")) for row in pq.read_table(path).to_pylist()
        ]
        tally.same(f"{root.name}, frames", info["total_frames"], len(frames))
        tally.same(f"{root.name}, episodes", info["total_episodes"], len(episodes))
        names = info["features"]["action"]["names"]
        for row in episodes:
            told = {name.removeprefix("minihuman/"): value for name, value in row.items() if "minihuman/" in name}
            key = told["participant"], told["session"], told["episode"], told["attempt"]
            where = f"lerobot {root.name} {key}"
            if key not in played:
                tally.wrong.append(f"{where}: no included episode has steps there")
                continue
            session, episode = played.pop(key)
            same_facts(where, told, facts(session, episode), tally)
            its = frames[row["dataset_from_index"] : row["dataset_to_index"]]
            tally.same(where, row["length"], len(episode.steps))
            steps, begin = episode.steps, episode.start_ns
            last = [place + 1 == len(steps) for place in range(len(steps))]
            actions = [[float(episode.start.action_names[step.action] == name) for name in names] for step in steps]
            for column, expected in (
                ("action", actions),
                ("discrete_action", [step.action for step in steps]),
                ("next.reward", [step.reward for step in steps]),
                ("next.done", last),
                ("next.success", [one and episode.outcome == "goal" for one in last]),
                ("time_s", [(t_ns - begin) / 1e9 for t_ns in times(episode)[1:]]),
            ):
                same_numbers(f"{where} {column}", [frame[column] for frame in its], expected, tally)
        for column in ("next.reward", "time_s"):
            values = np.array([frame[column] for frame in frames], float)
            of = statistics[column]
            where = f"lerobot {root.name}, statistics of {column}"
            found = [of[name][0] for name in ("min", "max", "mean", "std", "count")]
            expected = [values.min(), values.max(), values.mean(), values.std(), len(values)]
            tally.compared += len(found)
            if not np.allclose(found, expected, rtol=1e-6, atol=1e-9):  # ours is a running sum of squares
                tally.wrong.append(f"{where}: {found}; by the logs {expected}")
    tally.wrong += [f"lerobot lacks {key}" for key in played]


def read_tsv(path: Path, names: Sequence[str] = ()) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, names or None, delimiter="\t", quoting=csv.QUOTE_NONE))


def bids(value: Any) -> str:
    """A cell of BIDS."""
    if value is None or value == "":
        return "n/a"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9f}".rstrip("0").rstrip(".")
    return re.sub(r"[\t\r\n]+", " ", str(value))


def label(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", text)


def compare_bids(logs: Logs, out: Path, tally: Tally) -> None:
    """Participants, sessions, every run's events and motion, the questionnaires, and the derived tables."""
    task = label(logs.sessions[0].plan.study)
    people: dict[str, Row] = {}
    begun: dict[str, list[Row]] = defaultdict(list)
    for session in logs.sessions:
        who = "sub-" + label(session.who["participant"].removeprefix("sub-"))
        player = session.facts("facts")[0].get("player")
        people.setdefault(who, {"participant_id": who, "group": session.who["group"], "player": player})
        at = session.facts("segment")[0]["started_at"].removesuffix("Z")[:26]
        begun[who].append({"session_id": f"ses-{session.plan.session:02d}", "acq_time": at})
        compare_runs(logs, session, out, who, task, tally)
    tally.rows("bids participants", read_tsv(out / "participants.tsv"), list(people.values()))
    for who, rows in begun.items():
        tally.rows(f"bids sessions of {who}", read_tsv(out / who / f"{who}_sessions.tsv"), rows)
    compare_questionnaires(logs, out, tally)
    compare_tables(logs, out / "derivatives/minihuman/tables", tally)


def compare_runs(logs: Logs, session: Session, out: Path, who: str, task: str, tally: Tally) -> None:
    number = f"ses-{session.plan.session:02d}"
    folder, stem = out / who / number, f"{who}_{number}_task-{task}"
    counted = {id(episode) for _, episode, _ in logs.included}
    starts = session.facts("segment")
    for segment in range(1, session.segments + 1):
        episodes = [one for one in session.episodes if one.segment == segment]
        begin = session.offsets[segment - 1]
        rows = sorted(
            [*episode_events(episodes, begin, counted), *key_events(session, segment, episodes, begin)],
            key=lambda row: (row["onset"], ("key", "step", "episode", "flip", "pause").index(row["trial_type"])),
        )
        found = read_tsv(folder / "beh" / f"{stem}_run-{segment}_events.tsv")
        found = [row for row in found if row["trial_type"] != "pause"]
        where = f"bids {who} {number} run {segment}"
        tally.same(f"{where} events", len(found), len(rows))
        for place, (cells, row) in enumerate(zip(found, rows, strict=False), 1):
            for column in cells:
                expected = bids(row.get(column))
                if column == "duration" and row["trial_type"] != "key" and row.get("duration") is None:
                    expected = "0"
                if column in ("onset", "duration", "reward", "response_time") and "n/a" not in (
                    expected,
                    cells[column],
                ):
                    tally.compared += 1
                    if abs(float(cells[column]) - float(expected)) > 1.1e-9:
                        tally.wrong.append(f"{where} event {place} {column}: {cells[column]}; by the logs {expected}")
                else:
                    tally.same(f"{where} event {place} {column}", cells[column], expected)
        poses = [
            (t_ns - begin, one.pose)
            for episode in episodes
            for t_ns, one in zip(times(episode), (episode.start, *episode.steps), strict=True)
        ]
        motion = sorted((folder / "motion").glob(f"{stem}_tracksys-*_run-{segment}_motion.tsv"))
        moved = [cells for path in motion for cells in read_tsv(path, ("x", "z", "yaw", "latency"))]
        moved.sort(key=lambda cells: float(cells["latency"]))
        values = [[float(cells[name]) for name in ("x", "z", "yaw", "latency")] for cells in moved]
        expected = [[pose.x, pose.z, pose.yaw_rad, since * 1e-9] for since, pose in poses]
        tally.compared += 4 * len(expected)
        if len(values) != len(expected) or not np.allclose(values or [0], expected or [0], rtol=0, atol=1.1e-9):
            tally.wrong.append(f"{where} motion: {len(values)} rows; by the logs {len(expected)}")
        at = starts[segment - 1]["started_at"].removesuffix("Z")[:26]
        scans = read_tsv(folder / f"{who}_{number}_scans.tsv")
        mine = [row for row in scans if f"_run-{segment}_" in row["filename"]]
        tally.same(f"{where} acq_time", {row["acq_time"] for row in mine}, {at})


def episode_events(episodes: Sequence[Episode], begin: int, counted: set[int]) -> Iterator[Row]:
    for episode in episodes:
        place = {"block": episode.block, "episode": episode.number, "attempt": episode.attempt}
        moments = times(episode)
        yield {
            "onset": (moments[0] - begin) * 1e-9,
            "duration": (moments[-1] - moments[0]) * 1e-9,
            "trial_type": "episode",
            "outcome": episode.outcome,
            "counts": id(episode) in counted,
            "detail": episode.start.plan.world,
            **place,
        }
        for step, t_ns, response in zip(episode.steps, moments[1:], responses(episode), strict=True):
            yield {
                "onset": (t_ns - begin) * 1e-9,
                "trial_type": "step",
                "step": step.step,
                "action": episode.start.action_names[step.action],
                "key": key_name(step.key),
                "reward": float(step.reward),
                "response_time": None if response is None else response / 1e3,
                **place,
            }
        for frame in episode.frames:
            since = frame.flip_ns + episode.offset_ns - begin
            yield {"onset": since * 1e-9, "trial_type": "flip", "step": frame.step, **place}


def key_events(session: Session, segment: int, episodes: Sequence[Episode], begin: int) -> Iterator[Row]:
    """Presses, each with how long it was held, and the episode it came in."""
    presses = [key for number, key in session.keys if number == segment]
    of = {id(key): episode for episode in episodes for key in episode.keys}
    for place, key in enumerate(presses):
        if not key.down:
            continue
        until = next((one for one in presses[place + 1 :] if one.key == key.key), None)
        held = None if until is None or until.down else (until.t_ns - key.t_ns) * 1e-9
        row = {
            "onset": (key.t_ns + session.offsets[segment - 1] - begin) * 1e-9,
            "duration": held,
            "trial_type": "key",
            "key": key_name(key.key),
            "verdict": key.verdict,
        }
        episode = of.get(id(key))
        if episode is not None and key.t_ns + episode.offset_ns <= times(episode)[-1]:
            row |= {"block": episode.block, "episode": episode.number, "attempt": episode.attempt}
            row["action"] = episode.start.action_names[key.action] if key.HasField("action") else None
        yield row


def compare_questionnaires(logs: Logs, out: Path, tally: Tally) -> None:
    given: dict[str, dict[tuple[str, str], Row]] = defaultdict(dict)
    for session in logs.sessions:
        who = "sub-" + label(session.who["participant"].removeprefix("sub-"))
        which = who, f"ses-{session.plan.session:02d}"
        parts: dict[str, list[int]] = defaultdict(list)
        for number, part in enumerate(session.plan.parts):
            if part.kind == "questions":
                parts[part.name].append(number)
        for _, _, one in session.answers:
            time = parts[one.part_name].index(one.part) + 1
            column = one.item if time == 1 else f"{one.item}_{time}"
            row = given[one.part_name].setdefault(
                which, dict(zip(("participant_id", "session_id"), which, strict=True))
            )
            value = json.loads(one.value)
            row[column] = bids(json.dumps(value, ensure_ascii=False) if isinstance(value, list) else value)
    for name, rows in given.items():
        tally.rows(f"bids {name}", read_tsv(out / "phenotype" / f"{label(name)}.tsv"), list(rows.values()))
