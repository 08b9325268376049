"""What people answered is the same in the log, in the table and on the report's page, for every kind of question."""

import json
import re
import tomllib
from collections import Counter
from html import unescape
from pathlib import Path

import pandas as pd
import pytest

from minihuman.activities.questions.question import find_question_kind
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.tables import select
from minihuman.experiment.machine.events import Answered
from minihuman.log.read.session_reader import read_log
from minihuman.plugins import QUESTION_GROUP, list_plugin_names
from minihuman.reporting.questionnaire_scores import SCORE, add_last_blocks, task_load_table
from minihuman.reporting.sections import answers_table
from minihuman.reporting.template import format_number
from minihuman.runtime.simulated_session import simulate
from minihuman.testing.checks import build_study
from tests.report.pages import page
from tests.report.reports import write_report

PEOPLE = 5
STUDY = """
[study]
name = "kinds"
version = "1"
seed = 5
participants = 8
[keys]
keyboard_check = false
[[groups]]
name = "everyone"
parts = ["all", "quiz"]
[[questions]]
name = "all"
items = [
    { name = "pace", kind = "likert", ask = "Too fast?", points = 5 },
    { name = "mood", kind = "likert", ask = "How are you?", options = ["Bad", "So so", "Good"] },
    { name = "load", kind = "slider", ask = "How hard?" },
    { name = "hand", kind = "choice", ask = "Which hand?", options = ["Left", "Right"], codes = ["left", "right"] },
    { name = "pets", kind = "choices", ask = "Which pets?", options = ["Cat", "Dog", "None"] },
    { name = "age", kind = "number", ask = "How old?" },
    { name = "word", kind = "text", ask = "A word?" },
    { name = "story", kind = "long_text", ask = "What happened?" },
]
[[questions]]
name = "quiz"
max_attempts = 3
items = [ { name = "goal", kind = "choice", ask = "Where to?", options = ["A", "B", "C"], right = 2 } ]
"""
NEWER_KINDS = [kind for kind in list_plugin_names(QUESTION_GROUP, built_in=True) if f'kind = "{kind}"' not in STUDY]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data")
    tree = tomllib.loads(STUDY)
    for kind in NEWER_KINDS:
        example = {"name": kind, "kind": kind, "ask": "What?", **find_question_kind(kind).example}
        tree["questions"][0]["items"].append(example)
    protocol = build_study(tree)
    assert len(list(simulate(protocol, data, participants=PEOPLE, seed=3, player="random"))) == PEOPLE
    return data / "kinds"


def logged(study: Path) -> list[Answered]:
    logs = (read_log(path) for path in sorted(study.rglob("*.mcap")))
    return [event for log in logs for event in log.part_events if isinstance(event, Answered)]


def on_page(study: Path, out: Path) -> dict[str, tuple[str, int]]:
    """Of each question, what the page says was answered and how often."""
    text = write_report(select(study, processes=1), out)[0].read_text()
    rows = re.findall(r"<tr><td[^>]*>(?:all|quiz)</td><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td><td[^>]*>(\d+)</td>", text)
    return {item: (unescape(re.sub("</?bdi>", "", said)), int(n)) for item, said, n in rows}


@pytest.mark.program
def test_log_table_and_page_agree_in_every_kind_of_question(study: Path, tmp_path: Path) -> None:
    given = logged(study)
    assert {event.kind for event in given} == {*list_plugin_names(QUESTION_GROUP, built_in=True)}
    with StudyStore(StudySessions(study, processes=1), with_shortest=False) as store:
        rows = store.tables.table("answers").to_pylist()
    assert [(row["questions"], row["item"], row["attempt"], row["said"]) for row in rows] == [
        (event.part_name, event.item, event.attempt, event.words) for event in given
    ]
    for row, event in zip(rows, given, strict=True):
        assert row["answer_ms"] == pytest.approx((event.t_ns - event.shown_ns) / 1e6)
        assert 0 < row["first_ms"] <= row["answer_ms"]
        value = json.loads(event.value)
        assert row["answer"] == (json.dumps(value) if isinstance(value, list) else str(value))
        assert row["number"] == (value if isinstance(value, int | float) else None)
    shown = on_page(study, tmp_path)
    for item in dict.fromkeys(event.item for event in given):
        its = [event for event in given if event.item == item]
        said, many = shown[item]
        assert many == len(its)
        if find_question_kind(its[0].kind).answer_type in ("rating", "number"):
            values = [json.loads(event.value) for event in its]
            mean = format_number(sum(values) / len(values))
            assert said == f"mean {mean}, {format_number(min(values))} to {format_number(max(values))}"
        else:
            told = Counter(event.words for event in its)
            assert Counter(dict(re.findall(r"(?:^|, )([^()]*) \((\d+)\)", said))) == {
                words: str(count) for words, count in told.items()
            }


def test_who_goes_back_and_answers_anew_is_counted_once() -> None:
    row = {"participant": "sub-01", "session": 1, "questions": "all", "item": "age", "kind": "number", "attempt": 1}
    row |= {"part": 1, "answer": "30", "number": 30.0, "said": "30", "right": None, "answer_ms": 900.0}
    again = row | {"answer": "31", "number": 31.0, "said": "31"}
    text = page(answers=answers_table(pd.DataFrame([row, again])))
    assert "mean 31.0, 31.0 to 31.0" in text
    assert "<td>1</td>" in text or ">1</td>" in text


def test_what_was_asked_on_two_days_has_a_row_for_each() -> None:
    row = {"participant": "sub-01", "session": 1, "questions": "load", "item": "effort", "kind": "slider", "attempt": 1}
    row |= {"part": 1, "answer": "20", "number": 20.0, "said": None, "right": None, "answer_ms": 900.0}
    other = row | {"item": "age", "kind": "number", "answer": "30", "number": 30.0}
    later = row | {"session": 2, "answer": "60", "number": 60.0}
    text = page(answers=answers_table(pd.DataFrame([row, other, later])))
    told = re.findall(r"<td[^>]*>(effort|age)</td><td[^>]*>(\d)</td><td[^>]*>mean ([\d.]+),", text)
    assert told == [("effort", "1", "20.0"), ("effort", "2", "60.0"), ("age", "1", "30.0")]
    assert '<th class="word">session</th>' not in page(answers=answers_table(pd.DataFrame([row, other])))


def test_groups_have_a_row_each_in_their_order_so_that_their_answers_are_not_pooled() -> None:
    row = {"session": 1, "questions": "partner", "item": "trust", "kind": "likert", "attempt": 1, "part": 2}
    row |= {"right": None, "answer_ms": 900.0}
    given = [("sub-01", "pairs", 6), ("sub-02", "alone", 2), ("sub-03", "pairs", 7), ("sub-04", "late", 1)]
    rows = [
        row | {"participant": who, "group": group, "answer": str(n), "number": float(n), "said": str(n)}
        for who, group, n in given
    ]
    table = answers_table(pd.DataFrame(rows), ("pairs", "alone", "late"))
    assert table is not None
    assert table.heads == ("questions", "question", "group", "answers", "n", "right", "median time (s)")
    assert [cells[2:5] for cells in table.rows] == [
        ("pairs", "mean 6.50, 6.00 to 7.00", "2"),
        ("alone", "mean 2.00, 2.00 to 2.00", "1"),
        ("late", "mean 1.00, 1.00 to 1.00", "1"),
    ]
    assert "Over all participants of each group." in page(answers=table)
    pooled = answers_table(pd.DataFrame(rows), ("everyone",))
    assert pooled is not None
    assert [cells[2:4] for cells in pooled.rows] == [("mean 4.00, 1.00 to 7.00", "4")]
    assert "Over all participants." in page(answers=pooled)


def test_what_was_asked_after_each_block_has_a_row_for_each_time() -> None:
    row = {"session": 1, "questions": "load", "item": "effort", "kind": "slider", "attempt": 1}
    row |= {"said": None, "right": None, "answer_ms": 900.0}
    given = [("sub-01", 2, 20.0), ("sub-01", 4, 60.0), ("sub-02", 3, 30.0), ("sub-02", 5, 80.0)]  # groups' own parts
    rows = [row | {"participant": who, "part": part, "answer": str(n), "number": n} for who, part, n in given]
    text = page(answers=answers_table(pd.DataFrame(rows)))
    told = re.findall(r"<td[^>]*>effort</td><td[^>]*>(\d)</td><td[^>]*>(mean [^<]+)</td><td[^>]*>(\d)</td>", text)
    assert told == [("1", "mean 25.0, 20.0 to 30.0", "2"), ("2", "mean 70.0, 60.0 to 80.0", "2")]
    assert '<th class="word">session</th>' not in text


SCALES = ("mental", "physical", "temporal", "performance", "effort", "frustration")


def latin_square_of_task_load() -> pd.DataFrame:
    """Answers of two participants after the blocks easy and hard, in either order: 10 and 60, with one missing."""
    rows, parts = [], []
    for who, blocks in (("sub-01", ("easy", "hard")), ("sub-02", ("hard", "easy"))):
        for place, block in enumerate(blocks):
            part = 2 * place + 1
            parts.append({"participant": who, "session": 1, "part": part, "what": "started", "name": block})
            for scale in SCALES:
                number = {"easy": 10.0, "hard": 60.0}[block]
                if (who, block, scale) == ("sub-02", "hard", "effort"):
                    number = float("nan")
                row = {"participant": who, "group": "all", "session": 1, "questions": "load", "item": scale}
                row |= {"kind": "slider", "attempt": 1, "part": part + 1, "answer": str(number), "number": number}
                rows.append(row | {"said": None, "right": None, "answer_ms": 900.0})
    return add_last_blocks(pd.DataFrame(rows), pd.DataFrame(parts), ["easy", "hard"])


def test_questions_after_each_block_of_a_latin_square_are_listed_by_block() -> None:
    table = answers_table(latin_square_of_task_load())
    assert table is not None
    assert table.heads[:4] == ("questions", "question", "after", "answers")
    mental = [row[2:5] for row in table.rows if row[1] == "mental"]
    assert mental == [("easy", "mean 10.0, 10.0 to 10.0", "2"), ("hard", "mean 60.0, 60.0 to 60.0", "2")]


def test_the_task_load_of_each_condition_has_a_raw_score_of_those_who_answered_all() -> None:
    table = task_load_table(latin_square_of_task_load(), {"load"}, {"easy": "E", "hard": "H"}, ["all"])
    assert table is not None
    assert table.heads == ("group", "scale", "E", "H")
    cells = {row[1]: row[2:] for row in table.rows}
    assert [*cells] == [*SCALES, SCORE]
    assert cells["mental"] == ("10.0 (0.000), n 2", "60.0 (0.000), n 2")
    assert cells[SCORE] == ("10.0 (0.000), n 2", "60.0 (n/a), n 1")


def test_questions_that_a_session_asks_once_are_not_about_its_last_block() -> None:
    answers = latin_square_of_task_load()
    once = answers[answers["part"] == 4].drop(columns="after")
    parts = pd.DataFrame(
        {"participant": ["sub-01", "sub-02"], "session": 1, "part": 3, "what": "started", "name": ["hard", "easy"]}
    )
    assert set(add_last_blocks(once, parts, ["easy", "hard"])["after"]) == {""}
