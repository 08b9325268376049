"""Typed answers in a site: the page's judgement is Python's, and what no page judges is refused."""

import json
import random
import subprocess
from pathlib import Path
from typing import Any

import pytest

import minihuman.web.site
from minihuman.activities.questions.field_rules import describe_rules, judge_text, list_examples
from minihuman.activities.questions.question import QuestionItemSpec, build_draft
from minihuman.admin.protocol_file import read_protocol
from minihuman.cli import make_command_line
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.site_folder import digest_build, plan_site_session, write_site
from minihuman.web.site.support import require_site_support
from tests.machine import needs
from tests.web.site.test_collectors import PROTOCOL

ANSWERS = Path(minihuman.web.site.__file__).parent / "page" / "answers.js"
LETTERS = "0123456789.,-  \u2212\uff0c\u0663\u06f4\u066b\u066cx\U0001d7d9\u3000\ufeff"
NUMBERS = ("1,000", "1.000", "1.234,5", "12.345.678", "3.5", "019", " 42 ", "1,000,", "-2.", "9" * 400)
JUDGE = """
import { judgeText } from ADDRESS;
let text = "";
for await (const chunk of process.stdin) text += chunk;
console.log(JSON.stringify(JSON.parse(text).map(([rules, typed]) => judgeText(rules, typed))));
"""


def draw_judgements(count: int) -> list[tuple[dict[str, Any], str, str]]:
    """Draw questions, texts typed as their answers, and how Python judges them."""
    rng = random.Random(5)
    drawn = []
    for _ in range(count):
        question = QuestionItemSpec(
            name="q",
            kind=rng.choice(("number", "number", "text")),
            ask="?",
            required=rng.random() < 0.7,
            whole=rng.random() < 0.5,
            minimum=rng.choice((0.0, 18.0, -5.5)),
            maximum=rng.choice((20.0, 120.0, 5000.0)),
            longest=rng.choice((3, 2000)),
        )
        draft: Any = build_draft(question, rtl=False, language=rng.choice(("en", "de", "ar")), limit_note="{longest}")
        text = "".join(rng.choices(LETTERS, k=rng.randrange(9)))
        if rng.random() < 0.3:
            text = rng.choice(NUMBERS)
        draft.put_text(text)
        drawn.append((describe_rules(draft), text, judge_text(draft)))
    return drawn


@needs("node")
@pytest.mark.program
def test_the_page_judges_typed_answers_as_python_does():
    drawn = draw_judgements(4_000)
    judged = subprocess.run(
        ["node", "--input-type=module", "-e", JUDGE.replace("ADDRESS", json.dumps(ANSWERS.as_uri()))],
        input=json.dumps([(rules, text) for rules, text, _ in drawn]),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    expected = [judgement for _, _, judgement in drawn]
    assert json.loads(judged.stdout) == expected
    assert len(set(expected)) == 7


def test_a_number_has_an_example_of_each_judgement():
    age = QuestionItemSpec(name="age", kind="number", ask="?", minimum=18, maximum=99)
    draft: Any = build_draft(age, rtl=False, language="en", limit_note="{longest}")
    draft.put_text("44")
    examples = list_examples(draft)
    assert examples.keys() == {"empty", "note.required", "note.too_long", "note.whole_number", "note.range", "fine"}
    assert 18 <= int(examples["fine"]) <= 99
    assert draft.display_text == "44"


def write_short(folder: Path, old: str = "", new: str = "") -> Path:
    assert old in PROTOCOL
    path = folder / "short.toml"
    path.write_text(PROTOCOL.replace(old, new) if old else PROTOCOL, encoding="utf-8")
    return path


def test_what_depends_on_a_typed_answer_is_refused_by_name(tmp_path):
    for old, new, error in [
        ('kind = "text"', 'kind = "slider"', "asks 'work' of kind 'slider'; a site asks choice, choices"),
        ("required = false", "only_if = { age = [20] }", "asks 'work' depending on the typed answer 'age'"),
        ("maximum = 99", "maximum = 99\nright = 30", "has a correct answer to 'age', which is typed"),
    ]:
        protocol = read_protocol(write_short(tmp_path, old, new))
        with pytest.raises(SiteError, match=error):
            require_site_support(protocol, plan_site_session(protocol, 0))


def test_a_quiz_with_too_many_answers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("minihuman.web.site.screen_graph.MAX_GROUP_NODES", 20)
    with pytest.raises(SiteError, match="part 'quiz' has a question with more than 20 answers"):
        write_site(read_protocol(write_short(tmp_path)), tmp_path / "site", slots=1)


def test_an_import_says_which_slots_are_taken_more_than_once(tmp_path, capsys):
    protocol = write_short(tmp_path)
    build = digest_build(read_protocol(protocol))
    records = tmp_path / "records"
    records.mkdir()
    for number, slot in enumerate((0, 2, 2)):
        record = {
            "format": "minihuman-site",
            "version": 1,
            "id": f"{number:016x}",
            "study": "short",
            "build": build,
            "slot": slot,
            "started_unix_ms": 1_796_000_000_000 + number,
            "first": 0,
            "messages": [],
            "facts": {},
        }
        (records / f"{number}.json").write_text(json.dumps(record))
    words = ["import", str(records), "--study", str(tmp_path / "short"), "--protocol", str(protocol)]
    with pytest.raises(SystemExit):
        make_command_line().main(words, standalone_mode=False)
    assert "slots: 2 of 4 taken; 1 of them more than once: 3 (2 times)" in capsys.readouterr().out
