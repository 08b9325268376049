"""Columns of the tables of agent blocks."""

from minihuman.dataset.table_columns import (
    EPISODE_COLUMN,
    PART_COLUMN,
    SEGMENT_COLUMN,
    SESSION_COLUMNS,
    TIME_COLUMN,
    TableColumn,
)

POLICIES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    PART_COLUMN,
    TableColumn(
        "what", "text", "", "asked: a learner was asked for a policy; given: this one plays from now on; failed."
    ),
    TableColumn(
        "episode", "integer", "", "The first episode that a learner does not know of, or that the policy plays."
    ),
    TableColumn("policy", "text", "", "The SHA-256 of its file, or an agent's name; empty where there is none yet."),
    TableColumn("failure", "text", "", "Why there is none: how the learner or the agent failed."),
)


ADVICE = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("step", "integer", "", "The step that it follows, 0 for the reset: what it says of the next one."),
    TableColumn("policy_action", "integer", "", "The world's action that the policy would do, by its number."),
    TableColumn("probabilities", "text", "", "The policy's probability of each of the world's actions, a JSON list."),
)


CONTROLS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("step", "integer", "", "The step that it follows, 0 for the reset."),
    TableColumn("who", "text", "", "Who steers from now on: agent or person."),
    TableColumn("reason", "text", "", "start, key (the person took over), hand_back, no_policy or agent_failed."),
    TableColumn("pressed_ns", "integer", "ns", "When the key for it went down, session time."),
)
