"""The columns of every table: name, type, unit and meaning. The data dictionary is written from here."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import pyarrow as pa

from minihuman.log import topics

Kind = Literal["text", "key", "whole", "number", "yes_no"]  # a key is a text, named so that nobody reads a number
_ARROW = {"text": pa.string(), "key": pa.string(), "whole": pa.int64(), "number": pa.float64(), "yes_no": pa.bool_()}


@dataclass(frozen=True, slots=True)
class Column:
    """One column; the unit is "" for words, counts and numbers without one."""

    name: str
    kind: Kind
    unit: str
    meaning: str


_WHO = (
    Column("study", "text", "", "The study's name in the protocol."),
    Column("version", "text", "", "The protocol's version and the start of its SHA-256: other bytes, another version."),
    Column("participant", "text", "", "The participant's code."),
    Column("group", "text", "", "The group the participant was allocated to."),
    Column("session", "whole", "", "The participant's session, 1 for the first."),
)
_WHERE = (
    Column("segment", "whole", "", "The session's segment: 1, and one more after each resume."),
    Column("episode", "whole", "", "The session's episode, 1 for the first, as on the screen and in the figures."),
    Column("attempt", "whole", "", "1, or more where an interrupted episode was begun again."),
)
_BLOCK = (Column("block", "text", "", "The block's name in the protocol."),)
_LEFT_OUT = Column("left_out", "text", "", "Why the statistics leave this row out; empty where they do not.")

STEPS = (
    *_WHO,
    *_BLOCK,
    *_WHERE,
    Column("step", "whole", "", "1 for the episode's first."),
    Column("t_ns", "whole", "ns", "The same as t_s, exactly as logged."),
    Column("t_s", "number", "s", "When the step was done: session time, since the session's first segment began."),
    Column("action", "text", "", "The action's name."),
    Column("key", "key", "", "The physical key that caused it; empty for a tick's no-op."),
    Column("reward", "number", "", "The step's reward."),
    Column("reaction_ms", "number", "ms", "Key press minus the flip of the picture it answers."),
    Column("visible_effect", "yes_no", "", "Whether the observation changed."),
    Column("x", "number", "cell or m", "Place after the step, to the right."),
    Column("z", "number", "cell or m", "Place after the step, down the page."),
    Column("yaw_rad", "number", "rad", "Heading after the step, 0 along +x, counter-clockwise from above."),
    Column("terminated", "yes_no", "", "The world ended the episode."),
    Column("truncated", "yes_no", "", "A limit ended the episode."),
)
PRESSES = (
    *_WHO,
    *_BLOCK,
    *_WHERE,
    Column("t_ns", "whole", "ns", "The same as t_s, exactly as logged."),
    Column("t_s", "number", "s", "When the key moved: session time, since the session's first segment began."),
    Column("key", "key", "", "The physical key."),
    Column("down", "yes_no", "", "True for a press, false for a release."),
    Column("action", "text", "", "The action it asked for; empty where it has none."),
    Column(
        "verdict", "text", "", "What became of it: accepted, unmapped, spare, repeat, queued, not_playing, release."
    ),
)
KEYS = (
    *_WHO,
    *_BLOCK,
    Column("first_episode", "whole", "", "The episode from which this key map held, 1 for the session's first."),
    Column("key", "key", "", "The physical key."),
    Column("action", "text", "", "Its action; empty where it has none."),
    Column("presses", "whole", "", "How often it went down while an episode ran, auto-repeats left out."),
    Column("steps", "whole", "", "Steps it caused."),
    Column("in_vain", "whole", "", "Steps it caused that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("found_s", "number", "s", "Playing time in episodes until its action first showed; empty if it never did."),
    Column("found_steps", "whole", "", "Steps up to and with the press by which its action first showed."),
)
EPISODES = (
    *_WHO,
    *_BLOCK,
    *_WHERE,
    Column("episode_in_block", "whole", "", "1 for the block's first."),
    Column("world", "text", "", "The world's id."),
    Column("seed", "whole", "", "The seed of the layout."),
    Column("t_ns", "whole", "ns", "When the episode was reset: session time, since the first segment began."),
    Column("outcome", "text", "", "goal, timeout, failure, abandoned or cut_off."),
    Column("success", "yes_no", "", "Whether the outcome is goal."),
    Column("reward", "number", "", "Sum of the episode's rewards."),
    Column("steps", "whole", "", "Steps done."),
    Column("max_steps", "whole", "", "Steps allowed."),
    Column(
        "shortest_steps", "whole", "", "Fewest steps that can reach the goal; in 3D no fewer can. Empty if unknown."
    ),
    Column(
        "feasible_steps", "whole", "", "Steps of a way to the goal that was found and is possible. Empty if unknown."
    ),
    Column("excess_steps", "number", "", "Steps over feasible_steps; of episodes that reached the goal."),
    Column("log_excess_steps", "number", "", "ln(1 + steps over feasible_steps); who never got there is at max_steps."),
    Column("spl", "number", "", "Success weighted by path length: feasible_steps / steps, 0 without the goal."),
    Column("playing_s", "number", "s", "From the reset to the last step, pauses left out."),
    Column("reaction_mean_ms", "number", "ms", "Mean reaction time."),
    Column("reaction_median_ms", "number", "ms", "Median reaction time."),
    Column("path_length", "number", "cell or m", "Ground covered."),
    Column("path_efficiency", "number", "", "Straight distance from start to end over ground covered."),
    Column("turns_in_place", "whole", "", "Runs of turning on the spot."),
    Column("in_vain", "whole", "", "Steps that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("tags", "text", "", "The reviewers' tags in force, separated by spaces."),
    _LEFT_OUT,
)
_OVER_EPISODES = (
    Column("episodes", "whole", "", "Episodes that count."),
    Column("success", "number", "", "Share of them that reached the goal."),
    Column("reward_mean", "number", "", "Mean reward."),
    Column("reward_sd", "number", "", "Standard deviation of the reward over episodes (n - 1)."),
    Column("reward_first", "number", "", "Reward of the first episode that counts."),
    Column(
        "reward_slope", "number", "1/episode", "Change of the reward over the block's first five episodes, an episode."
    ),
    Column("steps_mean", "number", "", "Mean steps."),
    Column(
        "steps_at_limit_mean", "number", "", "Mean steps; an episode that never reached the goal counts its max_steps."
    ),
    Column("excess_steps_mean", "number", "", "Mean steps over feasible_steps, of episodes that reached the goal."),
    Column("log_excess_steps_mean", "number", "", "Mean of log_excess_steps."),
    Column("spl_mean", "number", "", "Mean of spl."),
    Column("playing_s_mean", "number", "s", "Mean playing time of an episode."),
    Column("reaction_median_ms", "number", "ms", "Median over all steps' reaction times."),
    Column("path_efficiency_mean", "number", "", "Mean path efficiency."),
    Column("in_vain_share", "number", "", "Share of steps that changed nothing to be seen."),
    Column("refused", "whole", "", "Presses with no action, or while no action was taken."),
    Column("keys_found", "whole", "", "Keys with an action whose action showed."),
    Column("keys_to_find", "whole", "", "Keys with an action."),
    Column("found_all_s", "number", "s", "Playing time until every key's action had shown; empty if one never did."),
)
BLOCKS = (*_WHO, *_BLOCK, *_OVER_EPISODES, _LEFT_OUT)
PARTICIPANTS = (
    *_WHO,
    Column("player", "text", "", "Whoever pressed the keys: human, or the simulated player's name."),
    Column("started_at", "text", "UTC", "When the session began, ISO 8601."),
    Column("end_reason", "text", "", "Why the session ended."),
    Column("clean", "yes_no", "", "Whether the log was finished in the ordinary way."),
    Column("segments", "whole", "", "How many stretches the session was played in: 1, and one for each resume."),
    Column(
        "completed_share",
        "number",
        "",
        "Share of the planned episodes, skipped ones apart, played to an end; empty where none was planned.",
    ),
    *_OVER_EPISODES,
    _LEFT_OUT,
)
_SEGMENT = (Column("segment", "whole", "", "The session's segment, 1 for the first; one more after each resume."),)
_T_NS = Column("t_ns", "whole", "ns", "Session time: since the session's first segment began.")
SEGMENTS = (
    *_WHO,
    *_SEGMENT,
    Column("started_at", "text", "UTC", "When the segment began, ISO 8601, from the wall clock."),
    Column("started_unix_ns", "whole", "ns", "The same, since 1970."),
    Column("started_monotonic_ns", "whole", "ns", "The machine's monotonic clock then; empty in older logs."),
    Column("monotonic_clock", "text", "", "That clock's name."),
    Column("start_ns", "whole", "ns", "Session time at which the segment began."),
    Column("end_ns", "whole", "ns", "Session time of the last that is known of it."),
    Column("end_reason", "text", "", "Why it ended; cut_off where it never said."),
    Column("clean", "yes_no", "", "Whether its log was finished in the ordinary way."),
    Column("player", "text", "", "Whoever pressed the keys."),
    Column("slot", "whole", "", "The participant's place in the allocation list, 1 for the first."),
    Column("overridden", "yes_no", "", "Whether participant or group were chosen by hand."),
    Column("allocation_sha256", "text", "", "SHA-256 of the allocation list; empty where the choice was by hand."),
    Column("study_version", "text", "", "The protocol's version."),
    Column("study_seed", "whole", "", "The study's seed."),
    Column("protocol_sha256", "text", "", "SHA-256 of the protocol file."),
    Column("consent_sha256", "text", "", "SHA-256 of the text that was agreed to; empty where there was none."),
    Column("station", "text", "JSON", "What is known of the station: versions, platform, display, refresh rate."),
)
PLAN = (
    *_WHO,
    *_BLOCK,
    Column("episode", "whole", "", "The session's episode, 1 for the first; played or not."),
    Column("episode_in_block", "whole", "", "1 for the block's first."),
    Column("world", "text", "", "The world's id."),
    Column("options", "text", "JSON", "The world's options."),
    Column("seed", "whole", "", "The seed of the layout."),
    Column("max_steps", "whole", "", "Steps allowed."),
    Column("actions", "text", "", "The actions that have a key, separated by spaces."),
    Column("key_map", "text", "JSON", "Physical key to action."),
    Column("key_map_seed", "whole", "", "The seed that drew the key map."),
    Column("spare_keys", "text", "", "The pool's other keys, separated by spaces."),
    Column("show_keys", "yes_no", "", "Whether the keys were on the screen."),
    Column("pace", "text", "", "on_key or real_time."),
    Column("step_period_ms", "number", "ms", "The time between steps; empty where keys make them."),
    Column("noop", "text", "", "The action of a tick without a key; empty where there is none."),
    Column("view", "text", "", "What was on the screen: partial or full."),
    Column("palette", "text", "", "classic or colour-safe."),
    Column("record_observations", "yes_no", "", "Whether the log holds what was observed."),
    Column("attempts", "whole", "", "How often it was begun; 0 where it was not played."),
)
STARTS = (
    *_WHO,
    *_BLOCK,
    *_WHERE,
    _T_NS,
    Column("mission", "text", "", "What the world asked for, in words."),
    Column("x", "number", "cell or m", "Where the episode began, to the right."),
    Column("z", "number", "cell or m", "Where the episode began, down the page."),
    Column("yaw_rad", "number", "rad", "Heading, 0 along +x, counter-clockwise from above."),
    Column("unit", "text", "", "The unit of places: cell or m; empty where the world has no map."),
    Column("map", "text", "JSON", "Bounds, walls and things of the floor plan."),
    Column("end_ns", "whole", "ns", "Session time of the last step, or of the reset where there is none."),
)
FRAMES = (
    *_WHO,
    *_BLOCK,
    *_WHERE,
    Column("step", "whole", "", "The step whose result the picture shows, 0 for the reset."),
    Column("submit_ns", "whole", "ns", "Session time at which the picture was handed over."),
    Column("flip_ns", "whole", "ns", "Session time at which it was on the display."),
)
OTHER_PRESSES = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("phase", "text", "", "What was on the screen."),
    Column("key", "key", "", "The physical key."),
    Column("symbol", "key", "", "What it types, as far as known."),
    Column("down", "yes_no", "", "True for a press, false for a release."),
    Column("verdict", "text", "", "What became of it."),
)
NOTES = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("kind", "text", "", "consent, phase, focus, keyboard_check, pause, resume and others."),
    Column("note", "text", "", "What was noted; of a pause its reason."),
)
SAMPLES = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("device", "text", "", "The device's name in the protocol."),
    Column("channel", "text", "", "Which of its numbers; empty for a sample that has none."),
    Column("value", "number", "", "The number, in the channel's unit."),
    Column("said", "text", "", "What the device said in words."),
)
MARKS = (
    *_WHO,
    Column("episode", "whole", "", "The marked episode, 1 for the first; empty where the whole session is marked."),
    Column("tag", "text", "", "The reviewer's tag."),
    Column("note", "text", "", "Why."),
    Column("at", "text", "UTC", "When it was marked, ISO 8601."),
    Column("taken_back", "yes_no", "", "Whether this line undoes an earlier mark of that tag."),
)
_PART = Column("part", "whole", "", "The session's part, 1 for the first.")
ANSWERS = (
    *_WHO,
    *_SEGMENT,
    _PART,
    Column("questions", "text", "", "The part's name in the protocol."),
    Column("item", "text", "", "The question's name in the protocol or the form."),
    Column("kind", "text", "", "likert, slider, choice, choices, number, text or long_text."),
    Column("attempt", "whole", "", "1, or more where the questions were asked again."),
    Column("t_ns", "whole", "ns", "When the answer was given, session time."),
    Column("answer", "text", "", "The option's code, the number or the text; several codes as a JSON list."),
    Column("number", "number", "", "The same as a number, where it is one."),
    Column("said", "text", "", "What the participant saw of it: the option's words."),
    Column("right", "yes_no", "", "Whether it is the right answer; empty where there is none."),
    Column("shown_ns", "whole", "ns", "When the question reached the display, session time."),
    Column("first_ms", "number", "ms", "From then to the first change."),
    Column("answer_ms", "number", "ms", "From then until it was given."),
    Column("changes", "whole", "", "How often it changed before it was given."),
)
ANSWER_CHANGES = (
    *_WHO,
    *_SEGMENT,
    _PART,
    Column("item", "text", "", "The question's name."),
    Column("t_ns", "whole", "ns", "When, session time."),
    Column("answer", "text", "", "What it was changed to, as JSON."),
)
PARTS = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    _PART,
    Column("what", "text", "", "started, or how it ended: done, failed, again or over."),
    Column("kind", "text", "", "The kind of activity: page, questions, keyboard_check, play or another."),
    Column("name", "text", "", "The part's name in the protocol."),
    Column("next", "whole", "", "The part that follows; one past the last where none does. Empty at a start."),
)
PAGES = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    _PART,
    Column("name", "text", "", "The part's name in the protocol."),
    Column("page", "whole", "", "The page that was shown, 1 for the first."),
    Column("pages", "whole", "", "How many the text has."),
    Column("submit_ns", "whole", "ns", "When it was handed to the display, session time."),
    Column("flip_ns", "whole", "ns", "When it was there, session time."),
)
POINTS = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("episode", "whole", "", "The session's episode, 1 for the first; the first of those that were skipped."),
    Column("points", "number", "", "What it was worth; empty where it was skipped."),
    Column("total", "number", "", "The session's points so far."),
    Column("skipped", "whole", "", "How many episodes were not played; empty for one that was."),
    Column("why", "text", "", "Why: criterion, time or given_up."),
)
CLAUSES = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("episode", "whole", "", "The session's episode, 1 for the first."),
    Column("step", "whole", "", "The step that did it, 1 for the first."),
    Column("clause", "whole", "", "Which clause of the episode's instruction, 1 for the first as it is read."),
    Column("text", "text", "", "What the clause says."),
)
OTHER_INPUTS = (
    *_WHO,
    *_SEGMENT,
    _T_NS,
    Column("what", "text", "", "typed, or what the pointer did: pressed, moved while pressed, released."),
    Column("text", "text", "", "What was typed."),
    Column("target", "text", "", "The spot the pointer went down in; empty for none."),
    Column("x", "number", "", "0 at the left edge of the drawn picture, 1 at the right."),
    Column("y", "number", "", "0 at its top, 1 at its bottom."),
    Column("along", "number", "", "0 to 1 inside the spot."),
)
TABLES: dict[str, tuple[Column, ...]] = {
    "steps": STEPS,
    "presses": PRESSES,
    "keys": KEYS,
    "episodes": EPISODES,
    "blocks": BLOCKS,
    "participants": PARTICIPANTS,
    "segments": SEGMENTS,
    "plan": PLAN,
    "starts": STARTS,
    "frames": FRAMES,
    "other_presses": OTHER_PRESSES,
    "notes": NOTES,
    "samples": SAMPLES,
    "marks": MARKS,
    "answers": ANSWERS,
    "answer_changes": ANSWER_CHANGES,
    "parts": PARTS,
    "pages": PAGES,
    "points": POINTS,
    "clauses": CLAUSES,
    "other_inputs": OTHER_INPUTS,
}


FROM_TOPICS = {
    topics.PLAN: ("plan", "segments"),
    topics.NOTE: ("notes",),
    topics.PAUSE: ("notes",),
    topics.KEY_MAP: ("plan",),
    topics.EPISODE_START: ("starts", "episodes"),
    topics.KEY: ("presses", "other_presses"),
    topics.STEP: ("steps",),
    topics.FRAME: ("frames",),
    topics.SAMPLE: ("samples",),
    topics.EPISODE_END: ("episodes",),
    topics.SESSION_END: ("segments",),
    topics.ANSWER: ("answers",),
    topics.ANSWER_CHANGE: ("answer_changes",),
    topics.PART: ("parts",),
    topics.PART_END: ("parts",),
    topics.PAGE: ("pages",),
    topics.POINTS: ("points",),
    topics.CLAUSE: ("clauses",),
    topics.SKIP: ("points",),
    topics.TEXT: ("other_inputs",),
    topics.POINTER: ("other_inputs",),
}
"""Which tables hold what is said on each of the log's topics. Stored observations are no rows: exports hold them."""

NEED_WORLD = frozenset(
    {"shortest_steps", "feasible_steps", "excess_steps", "log_excess_steps", "spl"}
    | {"excess_steps_mean", "log_excess_steps_mean", "spl_mean"}
)
"""The columns that a log alone cannot tell: the world itself is asked how few steps an episode could have taken."""


@cache
def schema(table: str, *, without: frozenset[str] = frozenset()) -> pa.Schema:
    """The table's Arrow schema, some columns left out, each field with its unit and meaning as metadata."""
    return pa.schema(
        [
            pa.field(column.name, _ARROW[column.kind], metadata={"unit": column.unit, "meaning": column.meaning})
            for column in TABLES[table]
            if column.name not in without
        ]
    )


def dictionary(*, without: frozenset[str] = frozenset()) -> dict[str, dict[str, dict[str, str]]]:
    """The data dictionary, some columns left out: table, column, then its type, unit and meaning."""
    return {
        table: {
            column.name: {"type": column.kind, "unit": column.unit, "meaning": column.meaning}
            for column in columns
            if column.name not in without
        }
        for table, columns in TABLES.items()
    }
