"""Columns of the tables that every session has: what its log says, and with them what is measured of it."""

from minihuman.dataset.measure_columns import BLOCKS, EPISODES, KEYS, PARTICIPANTS
from minihuman.dataset.table_columns import (
    BLOCK_COLUMNS,
    EPISODE_COLUMN,
    EPISODE_KEY,
    PART_COLUMN,
    SEGMENT_COLUMN,
    SESSION_COLUMNS,
    TIME_COLUMN,
    UNIT_COLUMN,
    TableColumn,
)

STEPS = (
    *EPISODE_KEY,
    TableColumn("step", "integer", "", "1 for the episode's first."),
    TableColumn("t_ns", "integer", "ns", "The same as t_s, exactly as logged."),
    TableColumn("t_s", "number", "s", "When the step was done: session time, since the session's first segment began."),
    TableColumn("action", "text", "", "The action's name."),
    TableColumn("key", "key", "", "The physical key that caused it; empty for a tick's no-op."),
    TableColumn("reward", "number", "", "The step's reward."),
    TableColumn(
        "reaction_ms",
        "number",
        "ms",
        "Milliseconds from when the latest picture was on the display to the key press; in real time that picture is "
        "only the last tick's: use response_ms.",
        1,
    ),
    TableColumn(
        "response_ms",
        "number",
        "ms",
        "Key press minus stimulus onset: turn-based, the flip of the latest picture; in real time, of the picture that "
        "the world or the block names, and empty without one.",
        2,
    ),
    TableColumn("visible_effect", "boolean", "", "Whether the observation changed."),
    TableColumn("x", "number", "cell or m", "Place after the step, to the right."),
    TableColumn("y", "number", "cell or m", "Height of the floor under the body after the step; 0 in a flat world."),
    TableColumn("z", "number", "cell or m", "Place after the step, down the page."),
    UNIT_COLUMN,
    TableColumn("yaw_rad", "number", "rad", "Heading after the step, 0 along +x, counter-clockwise from above."),
    TableColumn("terminated", "boolean", "", "The world ended the episode."),
    TableColumn("truncated", "boolean", "", "A limit ended the episode."),
    TableColumn("action_vector", "text", "", "The action, a JSON list, where actions are vectors; else empty."),
    TableColumn("info", "text", "JSON", "What record_info keeps of the world's info; empty where it keeps nothing."),
)


PRESSES = (
    *EPISODE_KEY,
    TableColumn("t_ns", "integer", "ns", "The same as t_s, exactly as logged."),
    TableColumn("t_s", "number", "s", "When the key moved: session time, since the session's first segment began."),
    TableColumn("key", "key", "", "The physical key."),
    TableColumn("down", "boolean", "", "True for a press, false for a release."),
    TableColumn("action", "text", "", "The action it asked for; empty where it has none."),
    TableColumn(
        "verdict",
        "text",
        "",
        "Its effect: accepted, unmapped, spare, repeat, queued, not_playing, typing, release; held_before_focus: it "
        "was down before the window had the focus; shortcut: beside Ctrl, Alt or Meta; release_at_focus_loss: the "
        "window lost the focus with the key down.",
    ),
)


SEGMENTS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TableColumn("started_at", "text", "UTC", "When the segment began, ISO 8601, from the wall clock."),
    TableColumn("started_unix_ns", "integer", "ns", "The same, since 1970."),
    TableColumn("started_monotonic_ns", "integer", "ns", "The machine's monotonic clock then; empty in older logs."),
    TableColumn("monotonic_clock", "text", "", "That clock's name."),
    TableColumn("start_ns", "integer", "ns", "Session time at which the segment began."),
    TableColumn("end_ns", "integer", "ns", "Session time of its last record."),
    TableColumn("end_reason", "text", "", "Why it ended; cut_off where the log gives no reason."),
    TableColumn("clean", "boolean", "", "Whether its log was finished in the ordinary way."),
    TableColumn("player", "text", "", "Who pressed the keys: human, or the simulated player's name."),
    TableColumn("window", "text", "", "The participant's window: pygame, pyglet, web or simulated; empty if unknown."),
    TableColumn("slot", "integer", "", "The participant's place in the allocation list, 1 for the first."),
    TableColumn("stratum", "text", "", "The stratum from whose list the group was drawn; empty without strata."),
    TableColumn("overridden", "boolean", "", "Whether participant or group were chosen by hand."),
    TableColumn("allocation_sha256", "text", "", "SHA-256 of the allocation list; empty where the choice was by hand."),
    TableColumn("study_version", "text", "", "The protocol's version."),
    TableColumn("study_seed", "integer", "", "The study's seed."),
    TableColumn("protocol_sha256", "text", "", "SHA-256 of the protocol file."),
    TableColumn("consent_sha256", "text", "", "SHA-256 of the consent text; empty where there was none."),
    TableColumn("station", "text", "JSON", "The station: versions, platform, display, refresh rate."),
)


PLAN = (
    *SESSION_COLUMNS,
    *BLOCK_COLUMNS,
    TableColumn("episode", "integer", "", "The session's episode, 1 for the first; played or not."),
    TableColumn("episode_in_block", "integer", "", "1 for the block's first."),
    TableColumn("world", "text", "", "The world's id."),
    TableColumn("options", "text", "JSON", "The world's options."),
    TableColumn("seed", "integer", "", "The seed of the layout."),
    TableColumn("max_steps", "integer", "", "Steps allowed."),
    TableColumn("actions", "text", "", "The actions that have a key, separated by spaces."),
    TableColumn("key_map", "text", "JSON", "Physical key to action."),
    TableColumn("key_map_seed", "integer", "", "The seed that drew the key map."),
    TableColumn("spare_keys", "text", "", "The pool's other keys, separated by spaces."),
    TableColumn("show_keys", "boolean", "", "Whether the keys were on the screen."),
    TableColumn("pace", "text", "", "on_key or real_time."),
    TableColumn("step_period_ms", "number", "ms", "The time between steps; empty where keys make them."),
    TableColumn("noop", "text", "", "The action of a tick without a key; empty where there is none."),
    TableColumn("view", "text", "", "What was on the screen: partial or full."),
    TableColumn("palette", "text", "", "classic or colour-safe."),
    TableColumn("record_observations", "boolean", "", "Whether the log holds what was observed."),
    TableColumn("attempts", "integer", "", "How often it was begun; 0 where it was not played."),
)


STARTS = (
    *EPISODE_KEY,
    TIME_COLUMN,
    TableColumn("mission", "text", "", "What the world asked for, in words."),
    TableColumn("x", "number", "cell or m", "Where the episode began, to the right."),
    TableColumn("y", "number", "cell or m", "Height of the floor where it began; 0 in a flat world."),
    TableColumn("z", "number", "cell or m", "Where the episode began, down the page."),
    TableColumn("yaw_rad", "number", "rad", "Heading, 0 along +x, counter-clockwise from above."),
    UNIT_COLUMN,
    TableColumn("map", "text", "JSON", "Bounds, walls and things of the floor plan."),
    TableColumn("end_ns", "integer", "ns", "Session time of the last step, or of the reset where there is none."),
)


FRAMES = (
    *EPISODE_KEY,
    TableColumn("step", "integer", "", "The step whose result the picture shows, 0 for the reset."),
    TableColumn("submit_ns", "integer", "ns", "Session time at which the picture was handed over."),
    TableColumn("flip_ns", "integer", "ns", "Session time at which it was on the display."),
)


OTHER_PRESSES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn("phase", "text", "", "What was on the screen."),
    TableColumn("key", "key", "", "The physical key."),
    TableColumn("symbol", "key", "", "What it types, as far as known."),
    TableColumn("down", "boolean", "", "True for a press, false for a release."),
    TableColumn("verdict", "text", "", "What became of it."),
)


NOTES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn("kind", "text", "", "consent, phase, focus, keyboard_check, pause, resume and others."),
    TableColumn("note", "text", "", "What was noted; of a pause its reason."),
)


SAMPLES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn("device", "text", "", "The device's name in the protocol."),
    TableColumn("channel", "text", "", "Which of its numbers; empty for a sample that has none."),
    TableColumn("value", "number", "", "The number, in the channel's unit."),
    TableColumn("said", "text", "", "What the device said in words."),
)


ANNOTATIONS = (
    *SESSION_COLUMNS,
    TableColumn(
        "episode", "integer", "", "The marked episode, 1 for the first; empty where the whole session is marked."
    ),
    TableColumn("tag", "text", "", "The reviewer's tag."),
    TableColumn("note", "text", "", "Why."),
    TableColumn("at", "text", "UTC", "When it was marked, ISO 8601."),
    TableColumn("taken_back", "boolean", "", "Whether this line undoes an earlier mark of that tag."),
)


PARTS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn("what", "text", "", "started, or how it ended: done, failed, again or over."),
    TableColumn("kind", "text", "", "The kind of activity: page, questions, keyboard_check, play or another."),
    TableColumn("name", "text", "", "The part's name in the protocol."),
    TableColumn("next", "integer", "", "The part that follows; one past the last where none does. Empty at a start."),
)


OTHER_INPUTS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn(
        "what",
        "text",
        "",
        "typed; what the pointer did: pressed, moved while pressed, released, held_before_focus (the click that gave "
        "the focus), cancelled (a release that no finger made); axis: one of a gamepad or of a stick on a touch screen "
        "moved, or the mouse by pixels.",
    ),
    TableColumn("text", "text", "", "What was typed."),
    TableColumn("target", "text", "", "The spot the pointer went down in, empty for none; the axis that moved."),
    TableColumn(
        "x",
        "number",
        "",
        "0 at the left edge of the screen, 1 at the right; of the world's picture where target is picture.",
    ),
    TableColumn("y", "number", "", "0 at its top, 1 at its bottom."),
    TableColumn("along", "number", "", "0 to 1 inside the spot; -1 to 1 of an axis."),
)


LINKS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    TableColumn("offset_ms", "number", "ms", "The server's clock minus the session's, which is the browser's."),
    TableColumn("error_ms", "number", "ms", "The offset is right to so much, either way: half the quickest way."),
    TableColumn("rtt_ms", "number", "ms", "How long a message took there and back, the last time."),
    TableColumn("least_rtt_ms", "number", "ms", "The quickest of the latest."),
    TableColumn(
        "drift_ppm", "number", "ppm", "How much faster the server's clock runs; empty until it can be estimated."
    ),
)


MODEL_CALLS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("call", "integer", "", "1 for the first request of the session."),
    TableColumn("state", "text", "", "answered, failed, or unknown where the program was killed before an answer."),
    TableColumn("step", "integer", "", "The step that the screen follows; 0 outside episodes."),
    TableColumn("screen", "text", "", "play, page or question."),
    TableColumn("attempt", "integer", "", "1, or more after an invalid answer to the same screen."),
    TableColumn("provider", "text", "", "Who runs the model, as the protocol calls them."),
    TableColumn("model", "text", "", "The model as the server calls it."),
    TableColumn("temperature", "number", "", "Of sampling."),
    TableColumn("prompt_tokens", "integer", "", "As the server counts; estimated where the state is unknown."),
    TableColumn("completion_tokens", "integer", "", "The same, of the answer."),
    TableColumn("price", "number", "", "By the protocol's prices, in its currency."),
    TableColumn("latency_ms", "number", "ms", "From the request to the whole answer."),
    TableColumn("answer", "text", "", "The whole answer."),
    TableColumn("reasoning", "text", "", "Where the server gives it."),
    TableColumn("finish_reason", "text", "", "As the server says."),
    TableColumn("verdict", "text", "", "valid or invalid; empty where there is no answer."),
    TableColumn("reading", "text", "", "How a valid answer was read."),
    TableColumn("error", "text", "", "Why there is no answer."),
    TableColumn("prompt_sha256", "text", "", "Of the messages sent, pictures by their digests."),
    TableColumn("picture_sha256", "text", "", "Of the picture's pixels; empty without one."),
)


SESSION_TABLES: dict[str, tuple[TableColumn, ...]] = {  # those that every session has, whatever its parts
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
    "marks": ANNOTATIONS,
    "parts": PARTS,
    "other_inputs": OTHER_INPUTS,
    "links": LINKS,
    "model_calls": MODEL_CALLS,
}
