"""Questions: answered by keys, text and pointer; what was given is what is logged."""

import json
from types import MappingProxyType

import pytest

from minihuman.admin.legibility import find_illegible_in_plan
from minihuman.display.drawing.screen import find_spot
from minihuman.experiment.machine.events import (
    AnswerChanged,
    Answered,
    EpisodesSkipped,
    PartEnded,
    SessionEnded,
    TextChanged,
)
from minihuman.experiment.machine.inputs import TEXT_RULES, KeyDown, PointerMoved, PointerPressed, TextEdited, TextInput
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.protocol_notices import list_protocol_notices
from tests.study.sessions import Desk
from tests.study.studies import plan_of, protocol

HD = (1280, 720)
ITEMS = {
    "choice": 'kind = "choice"\noptions = ["a", "b", "c"]\ncodes = ["A", "B", "C"]',
    "choices": 'kind = "choices"\noptions = ["a", "b", "c"]',
    "likert": 'kind = "likert"\nlow = "no"\nhigh = "yes"',
    "slider": 'kind = "slider"\nlow = "no"\nhigh = "yes"\nstep = 5',
    "number": 'kind = "number"\nminimum = 18\nmaximum = 99',
    "text": 'kind = "text"',
    "long_text": 'kind = "long_text"',
}


def asked(*kinds: str, more: str = "", language: str = "en", extra: str = "") -> Desk:
    items = "".join(f'[[questions.items]]\nname = "{kind}"\nask = "?"\n{ITEMS[kind]}\n{extra}\n' for kind in kinds)
    rest = f'[[questions]]\nname = "q"\ntitle = "T"\n{more}\n{items}'
    return Desk(plan_of(rest, ["q"], language=language))


def type_text(desk: Desk, text: str) -> None:
    desk.now_ns += 1
    desk.give(TextInput(desk.now_ns, text))


def point(desk: Desk, target: str, along: float = 0.5) -> None:
    desk.now_ns += 1
    desk.give(PointerPressed(desk.now_ns, 0.5, 0.5, target, along))


def answer(desk: Desk):
    [given] = desk.of(Answered)
    return json.loads(given.value), given


@pytest.mark.parametrize(
    ("kind", "keys", "value"),
    [
        ("choice", ["2"], "B"),
        ("choice", ["down", "down"], "B"),
        ("choice", ["up"], "C"),
        ("choices", ["1", "3", "1", "2"], [2, 3]),
        ("choices", ["space", "down", "space"], [1, 2]),
        ("likert", ["right", "right"], 5),
        ("likert", ["7"], 7),
        ("likert", ["left", "left", "left", "left", "left", "left"], 1),
        ("slider", ["right"], 50),
        ("slider", ["home", "right"], 5),
        ("slider", ["end", "page_down"], 90),
    ],
)
def test_keys_answer(kind, keys, value):
    desk = asked(kind)
    desk.press(*keys, "enter")
    assert answer(desk)[0] == value
    assert desk.of(SessionEnded)[0].reason == "complete"


@pytest.mark.parametrize(
    ("kind", "target", "along", "value"),
    [
        ("choice", "option:1", 0, "B"),
        ("choices", "option:2", 0, [3]),
        ("likert", "option:6", 0, 7),
        ("slider", "slider", 0.31, 30),
    ],
)
def test_the_pointer_answers(kind, target, along, value):
    desk = asked(kind)
    point(desk, target, along)
    point(desk, "go_on")
    assert answer(desk)[0] == value


def test_a_slider_follows_the_pointer_while_it_is_down():
    desk = asked("slider")
    point(desk, "slider", 0.1)
    for along in (0.2, 0.4, 0.8):
        desk.give(PointerMoved(desk.now_ns, 0.5, 0.5, "slider", along))
    point(desk, "go_on")
    value, given = answer(desk)
    assert (value, given.changes) == (80, 4)
    assert [json.loads(event.value) for event in desk.of(AnswerChanged)] == [10, 20, 40, 80]


@pytest.mark.parametrize("kind", ["choice", "choices", "likert", "slider"])
def test_every_spot_is_where_it_is_drawn(kind):
    desk = asked(kind, kind.replace("slider", "likert") if kind == "slider" else "slider")
    spots = {}
    for x in range(400):
        for y in range(200):
            name, along = find_spot(desk.session.screen, HD, x / 400, y / 200)
            spots.setdefault(name, []).append((x, along))
    expected = {"choice": 3, "choices": 3, "likert": 7, "slider": 0}[kind]
    assert {name for name in spots if name.startswith("option")} == {f"option:{n}" for n in range(expected)}
    if kind == "slider":
        line = sorted(spots["slider"])
        assert [along for _, along in line] == sorted(along for _, along in line)


def test_a_scale_runs_from_right_to_left_in_arabic():
    desk, arabic = asked("likert"), asked("likert", language="ar")
    places = []
    for screen in (desk.session.screen, arabic.session.screen):
        row = [find_spot(screen, HD, x / 400, y / 100)[0] for x in range(400) for y in (46, 48, 50, 52, 54, 56)]
        places.append([name for name in dict.fromkeys(row) if name])
    assert places[0] == [f"option:{n}" for n in range(7)]
    assert places[1] == places[0][::-1]
    arabic.press("left", "left", "enter")
    assert answer(arabic)[0] == 5


def test_text_is_typed_moved_in_and_taken_back():
    desk = asked("text")
    type_text(desk, "Gußß ")
    desk.press("backspace", "backspace", "left", "left")
    type_text(desk, "r")
    desk.press("end")
    type_text(desk, "!\n")
    desk.press("enter")
    assert answer(desk)[0] == "Gruß!"


def test_a_long_text_has_lines_and_is_left_by_tab():
    desk = asked("long_text")
    type_text(desk, "one")
    desk.press("enter")
    type_text(desk, "two")
    desk.press("tab")
    assert answer(desk)[0] == "one\ntwo"


@pytest.mark.parametrize(
    ("typed", "note"),
    [("", "answer this"), ("12.5", "whole"), ("17", "from 18 to 99"), ("-", "whole"), ("9" * 400, "whole")],
)
def test_a_number_that_cannot_be_is_not_taken(typed, note):
    desk = asked("number")
    type_text(desk, f"{typed}x")  # letters are no number
    desk.press("enter")
    assert note in desk.session.screen.note
    assert desk.of(Answered) == []
    desk.press(*["backspace"] * len(typed))
    type_text(desk, "44")
    desk.press("enter")
    assert answer(desk)[0] == 44


def test_a_range_is_said_in_plain_numbers():
    item = ITEMS["number"].replace("99", "12345678")
    plan = plan_of(f'[[questions]]\nname = "q"\n[[questions.items]]\nname = "n"\nask = "?"\n{item}', ["q"])
    desk = Desk(plan)
    type_text(desk, "9")
    desk.press("enter")
    assert "from 18 to 12345678" in desk.session.screen.note


def test_a_question_must_be_answered_unless_it_need_not():
    desk = asked("choice")
    desk.press("enter")
    assert "first" in desk.session.screen.note
    free = asked("choice", extra="required = false")
    free.press("enter")
    assert answer(free)[0] is None


def test_times_and_changes_are_logged():
    desk = asked("likert")
    desk.show()
    shown_ns = desk.now_ns
    desk.press("3", "4")
    desk.press("enter")
    _, given = answer(desk)
    assert (given.shown_ns, given.changes) == (shown_ns, 2)
    assert given.shown_ns < given.first_ns < given.t_ns


def test_one_can_go_back_to_the_question_before():
    desk = asked("choice", "likert")
    desk.press("2", "enter", "page_up")
    assert desk.session.screen.progress == "Question 1 of 2"
    desk.press("3", "enter", "1", "enter")
    assert [json.loads(event.value) for event in desk.of(Answered)] == ["B", "C", 1]


def test_escape_asks_from_a_question_and_the_answer_is_still_there():
    desk = asked("likert")
    desk.press("6", "escape", "enter", "enter")
    assert answer(desk)[0] == 6


def test_a_key_held_down_moves_a_slider_on():
    desk = asked("slider")
    desk.press("home")
    for _ in range(3):
        desk.give(KeyDown(desk.now_ns, "right", "", repeat=True))
    desk.press("enter")
    assert answer(desk)[0] == 15


QUIZ = """
[[pages]]
name = "how"
text = "Read this."
[[questions]]
name = "quiz"
max_attempts = 2
return_to = "how"
on_failure = "{failed}"
[[questions.items]]
name = "one"
kind = "choice"
ask = "?"
options = ["a", "b"]
right = 2
[[pages]]
name = "after"
text = "Well."
"""


def quiz(failed: str = "end") -> Desk:
    desk = Desk(plan_of(QUIZ.format(failed=failed), ["how", "quiz", "after"]))
    desk.press("enter")
    return desk


def test_a_quiz_sends_people_back_to_the_instructions_and_asks_again():
    desk = quiz()
    desk.press("1", "enter")
    assert desk.session.screen.title == "Not quite"
    desk.press("enter")
    assert desk.session.screen.body == "Read this."
    desk.press("enter", "2", "enter")
    assert desk.session.screen.body == "Well."
    assert [(event.attempt, event.right) for event in desk.of(Answered)] == [(1, False), (2, True)]
    assert [(event.part, event.end, event.next) for event in desk.of(PartEnded)][1] == (1, "again", 0)


@pytest.mark.parametrize(("failed", "reason"), [("end", "screened_out"), ("go_on", "complete")])
def test_after_the_last_try_the_study_ends_or_goes_on(failed, reason):
    desk = quiz(failed)
    desk.press("1", "enter", "enter", "enter", "1", "enter")
    if failed == "go_on":
        assert desk.session.phase is Phase.PAGE
        desk.press("enter")
    assert desk.of(SessionEnded)[0].reason == reason
    assert desk.of(EpisodesSkipped) == []


MATRIX = 'kind = "likert"\npoints = 5\nstatements = { calm = "I felt calm.", tense = "I felt tense.", odd = "Odd." }'


def matrix(**more) -> Desk:
    rest = f'[[questions]]\nname = "q"\n[[questions.items]]\nname = "mood"\nask = "Just now:"\n{MATRIX}\n'
    return Desk(plan_of(rest, ["q"], **more))


def test_each_statement_of_a_matrix_is_an_answer_of_its_own():
    desk = matrix()
    desk.press("4")
    point(desk, "option:5")  # the second row's first point
    desk.press("enter")
    assert not desk.of(Answered)
    assert desk.session.screen.note
    desk.press("down", "right", "right", "enter")
    given = [(event.item, json.loads(event.value), event.kind) for event in desk.of(Answered)]
    assert given == [("mood_calm", 4, "likert"), ("mood_tense", 1, "likert"), ("mood_odd", 4, "likert")]


@pytest.mark.parametrize("language", ["en", "ar"])
def test_a_matrix_is_pointed_at_where_it_is_drawn(language):
    screen = matrix(language=language).session.screen
    rows = [[find_spot(screen, HD, x / 300, y / 200)[0] for x in range(300)] for y in range(20, 160)]
    found = dict.fromkeys(tuple(name for name in dict.fromkeys(row) if name.startswith("option")) for row in rows)
    expected = [tuple(f"option:{row * 5 + point}" for point in range(5)) for row in range(3)]
    assert [row for row in found if row] == [row[::-1] if language == "ar" else row for row in expected]


SKIP = """
[[questions]]
name = "q"
[[questions.items]]
name = "smokes"
kind = "choice"
ask = "Do you smoke?"
options = ["yes", "no"]
[[questions.items]]
name = "many"
kind = "number"
ask = "How many a day?"
only_if = { smokes = [1] }
[[questions.items]]
name = "sleeps"
kind = "choice"
ask = "Do you sleep well?"
options = ["yes", "no"]
"""


@pytest.mark.parametrize(
    ("smokes", "items", "progress"),
    [("1", ["smokes", "many", "sleeps"], "Question 3 of 3"), ("2", ["smokes", "sleeps"], "Question 2 of 2")],
)
def test_a_question_is_skipped_where_an_earlier_answer_rules_it_out(smokes, items, progress):
    desk = Desk(plan_of(SKIP, ["q"]))
    desk.press(smokes, "enter")
    if smokes == "1":
        type_text(desk, "7")
        desk.press("enter")
    assert desk.session.screen.progress == progress
    desk.press("page_up")
    assert desk.session.screen.question == ("How many a day?" if smokes == "1" else "Do you smoke?")
    desk.press("enter", "1", "enter")
    assert list(dict.fromkeys(event.item for event in desk.of(Answered))) == items
    assert desk.of(SessionEnded)[0].reason == "complete"


class FieldDesk(Desk):
    """A desk whose session takes whole texts."""

    facts = MappingProxyType({**Desk.facts, "text_rules": TEXT_RULES})


def ask_in_field(kind: str, extra: str = "") -> FieldDesk:
    item = f'[[questions.items]]\nname = "{kind}"\nask = "?"\n{ITEMS[kind]}\n{extra}\n'
    return FieldDesk(plan_of(f'[[questions]]\nname = "q"\ntitle = "T"\n{item}', ["q"]))


def edit(desk: Desk, text: str, *changes: str) -> None:
    desk.now_ns += 10
    desk.give(TextEdited(desk.now_ns, text, changes, len(text), desk.now_ns - 5))  # type: ignore[arg-type]


def test_the_text_in_a_field_is_the_answer_code_point_for_code_point() -> None:
    desk = ask_in_field("long_text")
    text = " \u0645\u06cc\u200c\u062e\u00a0?\n "
    edit(desk, "first", "typed")
    edit(desk, text, "pasted", "script")
    desk.press("tab")
    value, given = answer(desk)
    assert value == given.words == text
    assert (given.changes, given.first_ns) == (2, desk.of(TextChanged)[0].t_ns - 5)
    assert [(change.text, change.changes) for change in desk.of(TextChanged)] == [
        ("first", ("typed",)),
        (text, ("pasted", "script")),
    ]


def test_a_field_of_blanks_is_no_answer_and_a_number_is_one_with_blanks_around() -> None:
    desk = ask_in_field("text")
    edit(desk, "  ")
    desk.press("enter")
    assert desk.of(Answered) == []
    desk = ask_in_field("number")
    edit(desk, "2x")
    desk.press("enter")
    assert desk.of(Answered) == []
    edit(desk, " 21 ")
    desk.press("enter")
    value, given = answer(desk)
    assert (value, given.words) == (21, " 21 ")


def test_a_text_that_is_too_long_is_said_to_be_so_at_once_and_cannot_be_given() -> None:
    desk = ask_in_field("text", "longest = 3")
    edit(desk, "four")
    assert "3" in desk.session.screen.note
    desk.press("enter")
    assert desk.of(Answered) == []
    edit(desk, "for")
    desk.press("enter")
    assert answer(desk)[0] == "for"


def test_where_the_session_edits_by_keys_a_whole_text_does_nothing() -> None:
    desk = asked("text")
    edit(desk, "whole")
    assert desk.of(TextChanged) == []
    type_text(desk, " a\u00a0b ")
    desk.press("enter")
    assert answer(desk)[0] == "ab"


def test_the_text_of_another_field_than_the_present_ones_does_nothing() -> None:
    desk = ask_in_field("text")
    desk.give(TextEdited(desk.now_ns + 1, "late", ("typed",), 4, 0, "another"))
    assert desk.of(TextChanged) == []
    desk.give(TextEdited(desk.now_ns + 2, "here", ("typed",), 4, 0, "text"))
    assert [change.text for change in desk.of(TextChanged)] == ["here"]


LONG_STATEMENT = "I knew at each moment where in the building I was"
LONG_POINTS = [
    "not at all, or only now and then",
    "partly, as far as I know",
    "mostly",
    "completely, from start to end",
]


def matrix_of(statement: str, count: int, points: list[str]) -> str:
    """A matrix of so many statements, each numbered, rated on named points."""
    statements = ", ".join(f's{number} = "{statement} {number}"' for number in range(count))
    return f"""
[[questions]]
name = "rating"
[[questions.items]]
name = "views"
kind = "likert"
ask = "How much do you agree?"
statements = {{ {statements} }}
options = {points}
"""


@pytest.mark.parametrize(
    ("statement", "count", "points", "fits"),
    [
        ("I knew where I was", 8, ["no", "partly", "yes"], True),
        (LONG_STATEMENT, 4, ["no", "partly", "yes"], True),
        (LONG_STATEMENT, 8, LONG_POINTS, False),
    ],
)
def test_statements_fit_the_rows_that_heads_and_their_number_leave(statement, count, points, fits):
    plan = plan_of(matrix_of(statement, count, points), ["rating"])
    problems = [problem for problem in find_illegible_in_plan(plan) if "views" in problem]
    if fits:
        assert problems == []
    else:
        [problem] = problems
        assert f"with its {count} statements" in problem


def test_fields_that_a_kind_does_not_use_are_named():
    study = """
[[groups]]
name = "all"
parts = ["about"]
[[questions]]
name = "about"
[[questions.items]]
name = "tilt"
kind = "slider"
ask = "How far?"
unit = "degrees"
low = "not at all"
[[questions.items]]
name = "hand"
kind = "choice"
ask = "Which hand?"
options = ["left", "right"]
"""
    [notice] = list_protocol_notices(protocol(study))
    assert notice.startswith(
        "questions 'about': 'tilt': unit has no effect on a question of kind 'slider', which uses "
    )
