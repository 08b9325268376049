"""One session's rows for every table, column by column."""

from collections.abc import Sequence

import numpy as np

from minihuman.data.around import around
from minihuman.data.counted import Counted
from minihuman.data.measured import Measured, Row, place
from minihuman.data.part_rows import part_rows
from minihuman.data.rows import Part, Rows
from minihuman.data.selection import about_session
from minihuman.data.versions import version_name
from minihuman.measures.keys import Tally, key_uses, visible_effect
from minihuman.recorded.categorical import Words
from minihuman.recorded.columns import NO_ACTION
from minihuman.recorded.episode import Episode

NOTHING_COUNTS = "no episode counts"


def session_tables(counted: Counted, measured: Measured) -> Rows:
    """Every table's rows of one session: of the episodes that are asked for.

    Rows that do not count stay in the tables, with the reason in ``left_out``; block and participant rows are over the
    episodes that count, keys' rows over all that were begun in those blocks.
    """
    log = counted.log
    who: Row = {
        "study": log.plan.study,
        "version": version_name(log.plan),
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
    }
    asked = [place for place, is_asked in enumerate(counted.asked) if is_asked]
    played = [log.episodes[at] for at in asked]
    episodes = [
        who
        | measured.rows[at]
        | {"tags": " ".join(sorted(counted.tags[at])), "left_out": counted.session_reason or counted.reasons[at]}
        for at in asked
    ]
    counting = [at for at in asked if not counted.reasons[at]]
    blocks = [
        who | {"block": name} | measured.over([at for at in counting if measured.rows[at]["block"] == name])
        for name in dict.fromkeys(episode.plan.block_name for episode in played)
    ]
    participant = who | about_session(log) | measured.over(counting)
    for row in blocks:
        row["left_out"] = counted.session_reason or ("" if row["episodes"] else NOTHING_COUNTS)
    participant["left_out"] = counted.session_reason or ("" if counted.counts else NOTHING_COUNTS)
    steps, presses = (Part.below([of(episode) for episode in played], **who) for of in (_steps, _presses))
    return Rows(
        {
            "steps": steps,
            "presses": presses,
            "keys": Part.of([who | row for row in _keys(measured.of_blocks({one.plan.block_name for one in played}))]),
            "episodes": Part.of(episodes),
            "blocks": Part.of(blocks),
            "participants": Part.of([participant] if counted.wanted else []),
        }
        | around(log, played, who, counted.marks, wanted=counted.wanted)
        | part_rows(log, who, wanted=counted.wanted)
    )


def _steps(episode: Episode) -> Part:
    n = len(episode.actions)
    columns = {
        "step": np.arange(1, n + 1),
        "t_ns": episode.t_ns[1:],
        "t_s": episode.t_ns[1:] / 1e9,
        "action": Words(episode.actions, episode.start.action_names),
        "key": Words.of(episode.step_keys),
        "reward": episode.rewards,
        "reaction_ms": episode.rt_ms,
        "visible_effect": visible_effect(episode),
        "x": episode.poses[1:, 0],
        "z": episode.poses[1:, 2],
        "yaw_rad": episode.poses[1:, 3],
        "terminated": episode.terminated,
        "truncated": episode.truncated,
    }
    return Part(n, place(episode) | columns)


def _presses(episode: Episode) -> Part:
    keys = episode.keys
    columns = {
        "t_ns": keys.column("t_ns"),
        "t_s": keys.column("t_ns") / 1e9,
        "key": keys.column("key"),
        "down": keys.column("down"),
        "action": Words(keys.column("action") - NO_ACTION, ("", *episode.start.action_names)),
        "verdict": keys.column("verdict"),
    }
    return Part(len(keys), place(episode) | columns)


def _keys(tallies: Sequence[Tally]) -> list[Row]:
    plans = [tally.episode.plan for tally in tallies]
    blocks = {plan.episode + 1: plan.block_name for plan in plans}
    return [
        {
            "block": blocks[use.first_episode],
            "first_episode": use.first_episode,
            "key": use.key,
            "action": use.action or "",
            "presses": use.presses,
            "steps": use.steps,
            "in_vain": use.in_vain,
            "refused": use.refused,
            "found_s": use.found_s,
            "found_steps": use.found_steps,
        }
        for use in key_uses(tallies)
    ]
