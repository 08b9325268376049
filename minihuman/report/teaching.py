"""What people taught agents, on the page: who steered, how policy and person agreed, what was rated and preferred."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np
import pandas as pd

from minihuman.data.selection import Selection
from minihuman.data.store import Kept
from minihuman.figures import drawings
from minihuman.figures.drawn_from import light
from minihuman.figures.kept import KeptFigures
from minihuman.log.read.open_log import open_log
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.recorded.taught import NO_ADVICE, Taught
from minihuman.report.html import number, table

TaughtEpisode = tuple[Episode, Taught]
_MS_PER_MIN = 60_000.0


def taught_logs(kept: Sequence[Kept], controls: pd.DataFrame, selection: Selection) -> Mapping[str, SessionLog]:
    """The sessions that an agent had a part in, by participant and session, each with its episodes that count.

    None is opened where no agent had a part in any; one of which nothing counts is left out.
    """
    if controls.empty:
        return {}
    wanted = set(zip(controls["participant"], controls["session"], strict=True))
    judged = (selection.judge(open_log(Path(one.path))) for one in kept if one.outline is not None)
    logs = (counted.session for counted in judged if counted.places)
    found = {(log.plan.participant.id, log.plan.session): log for log in logs}
    return {f"{who} session {number}": log for (who, number), log in sorted(found.items()) if (who, number) in wanted}


def blocks_of(log: SessionLog) -> dict[str, list[TaughtEpisode]]:
    """The episodes with an agent, by block."""
    found: dict[str, list[TaughtEpisode]] = defaultdict(list)
    for episode in log.episodes:
        if episode.taught is not None and len(episode.actions):
            found[episode.plan.block_name].append((episode, episode.taught))
    return found


def steered_min(episode: Episode, taught: Taught) -> float:
    """Minutes in which the person steered, pauses left out."""
    begins, ends = episode.t_ns[:-1], episode.t_ns[1:]
    took = ends - begins
    for pause_ns, resume_ns in episode.pauses:
        took = took - np.clip(np.minimum(ends, resume_ns) - np.maximum(begins, pause_ns), 0, None)
    return float(took[taught.by_person].sum() / 1e6 / _MS_PER_MIN)


def agreement(told: Sequence[TaughtEpisode]) -> float:
    """The share of the person's steps at which the policy would have done the same; NaN without any."""
    same = [
        taught.policy_actions[mine] == episode.actions[mine]
        for episode, taught in told
        if (mine := taught.by_person & (taught.policy_actions != NO_ADVICE)).any()
    ]
    return float(np.concatenate(same).mean()) if same else float("nan")


def gained_per_min(told: Sequence[TaughtEpisode]) -> float:
    """By how much the agent's share of an episode's steps grew with each minute that the person had steered before.

    The slope of a least-squares line; NaN where the person's minutes do not tell episodes apart.
    """
    minutes = np.cumsum([0.0, *(steered_min(episode, taught) for episode, taught in told)])[:-1]
    shares = np.array([float((~taught.by_person).mean()) for _, taught in told])
    spread = minutes - minutes.mean()
    total = float((spread**2).sum())
    return float((spread * shares).sum() / total) if total > 0 else float("nan")


def teaching_figures(logs: Mapping[str, SessionLog], drawn: KeptFigures, out: Path) -> Iterator[tuple[str, Path, str]]:
    """Who steered when, and what was rated over time: figures a session and block."""
    for name, log in logs.items():
        for block, told in blocks_of(log).items():
            where = out / f"{block}_steering_{name.replace(' ', '_')}"
            episodes = [light(episode) for episode, _ in told]
            png, _ = drawn.save(where, drawings.steering, episodes)
            yield block, png, f"Who steered when in block {block}, {name}; a line: from there on another policy played."
            if any(taught.ratings for _, taught in told):
                where = out / f"{block}_ratings_{name.replace(' ', '_')}"
                png, _ = drawn.save(where, drawings.ratings, episodes)
                said = (
                    f"What was rated in block {block}, {name}: presses, and the share of good ones among the last ten"
                )
                yield block, png, f"{said}; a dotted line: from there on another policy played."


def teaching_section(logs: Mapping[str, SessionLog]) -> list[str]:
    """The page's section; empty where no agent played."""
    if not logs:
        return []
    rows = [_row(name, block, told) for name, log in logs.items() for block, told in blocks_of(log).items()]
    caption = (
        "Teaching, a row a session and block, of the episodes that count. Takeovers: by a key while the agent steered. "
        "Person: the share of the steps, and the minutes without pauses, that they steered. Agreement: where the "
        "person steered, the share of the steps at which the policy would have done the same. Gain: by how much the "
        "agent's share of an episode's steps grew with each minute that the person had steered before (slope of a "
        "line). Good, bad: presses."
    )
    heads = ("session", "block", "episodes", "policies", "takeovers an episode", "person", "min", "agreement")
    parts = ["<h2>Teaching</h2>", table(caption, (*heads, "gain a minute", "good", "bad"), rows, words=2)]
    corrected = [
        (name, str(len(log.corrections)), str(sum(len(each.actions) for each in log.corrections)))
        for name, log in logs.items()
        if log.corrections
    ]
    if corrected:
        told = "Corrections after the fact: how many, and of how many steps together."
        parts.append(table(told, ("session", "corrections", "steps"), corrected))
    if any(log.comparisons for log in logs.values()):
        parts.append(_preferences(logs))
    return parts


def _row(name: str, block: str, told: Sequence[TaughtEpisode]) -> tuple[str, ...]:
    steps = np.concatenate([taught.by_person for _, taught in told])
    ratings = [rating.value for _, taught in told for rating in taught.ratings]
    return (
        escape(name),
        escape(block),
        str(len(told)),
        str(len({taught.policy for _, taught in told if taught.policy})),
        number(sum(taught.interventions for _, taught in told) / len(told), 2),
        number(float(steps.mean()), 2),
        number(sum(steered_min(episode, taught) for episode, taught in told), 2),
        number(agreement(told), 2),
        number(gained_per_min(told), 2, sign="+"),
        str(sum(value > 0 for value in ratings)),
        str(sum(value < 0 for value in ratings)),
    )


def _preferences(logs: Mapping[str, SessionLog]) -> str:
    rows = []
    for name, log in logs.items():
        said = [compared.said.answer for compared in log.comparisons]
        if said:
            took = [compared.answer_ms for compared in log.comparisons if not np.isnan(compared.answer_ms)]
            counts = [str(said.count(answer)) for answer in ("left", "right", "equal", "cannot_tell")]
            again = str(sum(compared.said.replays for compared in log.comparisons))
            rows.append((escape(name), str(len(said)), *counts, number(float(np.median(took)) / 1e3, 2), again))
    caption = (
        "Comparisons: what was said of pairs, the median time to the answer, how often pairs were asked for again."
    )
    heads = ("session", "pairs", "left", "right", "equal", "cannot tell", "s", "again")
    return table(caption, heads, rows)
