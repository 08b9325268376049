"""Columns of the tables of team blocks."""

from minihuman.dataset.table_columns import (
    BLOCK_COLUMNS,
    EPISODE_COLUMN,
    EPISODE_COLUMNS,
    SEGMENT_COLUMN,
    SESSION_COLUMNS,
    TIME_COLUMN,
    TableColumn,
)

TEAMS = (
    *SESSION_COLUMNS,
    *BLOCK_COLUMNS,
    *EPISODE_COLUMNS,
    TableColumn("team", "text", "", "The team's random id, the same in each member's rows."),
    TableColumn("team_index", "integer", "", "The team's number in the study, 1 for the first."),
    TableColumn("seat", "integer", "", "The body that the participant had, 0 for the first."),
    TableColumn("role", "text", "", "What the seat is called; empty where the protocol names none."),
    TableColumn("partner", "text", "", "What the other seats were: person, or an agent; with a plus between several."),
    TableColumn("seats", "text", "", "What each seat was, by seat, a JSON list."),
    TableColumn("outcome", "text", "", "How the episode ended, as in episodes."),
    TableColumn("joint_steps", "integer", "", "Joint steps made."),
    TableColumn("team_reward", "number", "", "Mean over the seats of what each earned: a shared reward counts once."),
    TableColumn("late", "integer", "", "Inputs of this seat that came after their step was closed."),
    TableColumn("idled", "integer", "", "Steps in which this seat idled, as no input had come."),
    TableColumn("corrected", "integer", "", "Pictures of a turn's own action that the others' actions changed."),
    TableColumn("takeovers", "integer", "", "How often an agent took a person's seat."),
    TableColumn("agent_steps", "integer", "", "Steps in which an agent acted in a person's seat."),
    TableColumn(
        "played_by", "text", "", "By seat, how many joint steps a person, late (the idle action) or an agent acted in."
    ),
    TableColumn(
        "absent_share", "number", "", "Share of joint steps in which a person's seat idled or an agent acted in it."
    ),
    TableColumn("absences", "text", "", "By seat, how often each state but here was seen: closed, idle, ..."),
    TableColumn("digest", "text", "", "Of the episode's joint actions, hexadecimal: equal for each member of a team."),
)


ABSENCES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("step", "integer", "", "The joint step that was open, 1 for the first."),
    TableColumn("seat", "integer", "", "The seat that is seen otherwise than before, 0 for the first."),
    TableColumn(
        "state", "text", "", "What of it is seen: here, idle, unfocused, silent, closed, left (for a page) or offline."
    ),
    TableColumn("for_ms", "integer", "ms", "How long it had been so; of one that is here again, since the last sign."),
)


JOINT_STEPS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    TIME_COLUMN,
    EPISODE_COLUMN,
    TableColumn("step", "integer", "", "The joint step, 1 for the first."),
    TableColumn("actions", "text", "", "The action of each seat, by the world's numbers, a JSON list."),
    TableColumn("rewards", "text", "", "What each seat earned, a JSON list."),
    TableColumn("sources", "text", "", "Who acted in each seat: person, late (the idle action) or agent, a JSON list."),
)
