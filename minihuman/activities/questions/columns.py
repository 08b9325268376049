"""Columns of the tables of answers."""

from minihuman.dataset.table_columns import PART_COLUMN, SEGMENT_COLUMN, SESSION_COLUMNS, TableColumn

ANSWERS = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    PART_COLUMN,
    TableColumn("questions", "text", "", "The part's name in the protocol."),
    TableColumn("item", "text", "", "The question's name in the protocol or the form."),
    TableColumn("kind", "text", "", "The kind of question: its name in the protocol."),
    TableColumn("attempt", "integer", "", "1, or more where the questions were asked again."),
    TableColumn("t_ns", "integer", "ns", "When the answer was given, session time."),
    TableColumn("answer", "text", "", "The code, the number or the text; several codes as a JSON list."),
    TableColumn("number", "number", "", "The same as a number, where it is one."),
    TableColumn("said", "text", "", "What the participant saw of it: the option's words."),
    TableColumn("right", "boolean", "", "Whether it is the right answer; empty where there is none."),
    TableColumn("shown_ns", "integer", "ns", "When the question reached the display, session time."),
    TableColumn("first_ms", "number", "ms", "From then to the first change."),
    TableColumn("answer_ms", "number", "ms", "From then until it was given."),
    TableColumn("changes", "integer", "", "How often it changed before it was given."),
)


ANSWER_CHANGES = (
    *SESSION_COLUMNS,
    *SEGMENT_COLUMN,
    PART_COLUMN,
    TableColumn("item", "text", "", "The question's name."),
    TableColumn("t_ns", "integer", "ns", "When, session time."),
    TableColumn("answer", "text", "", "What it was changed to, as JSON."),
    TableColumn(
        "how",
        "text",
        "",
        "How a text in a field was changed: typed, pasted, dropped, composed, replaced, undone or script.",
    ),
    TableColumn("keys", "integer", "", "Keys pressed in the field for it; empty for other answers."),
)
