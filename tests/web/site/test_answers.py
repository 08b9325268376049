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
from minihuman.experiment.machine.inputs import (
    Input,
    KeyDown,
    KeyUp,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    TextEdited,
    Tick,
)
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.participant_codes import format_participant_code, parse_participant_code
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.runtime.machine import collect_machine_facts
from minihuman.web.computed import PageWorld
from minihuman.web.prefetch import describe_screen
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.site_folder import digest_build, plan_site_session, write_site
from minihuman.web.site.support import require_site_support
from tests.counts import count
from tests.machine import needs
from tests.web.site.test_collectors import PROTOCOL

PAGE = Path(minihuman.web.site.__file__).parent / "page"
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


def run_module(program: str, module: str, given: Any) -> Any:
    """Run a program in Node that uses one of the site's modules; return what it prints."""
    address = json.dumps((PAGE / module).as_uri())
    words = ["node", "--input-type=module", "-e", program.replace("ADDRESS", address)]
    done = subprocess.run(words, input=json.dumps(given), capture_output=True, text=True, check=True, timeout=120)
    return json.loads(done.stdout)


@needs("node")
@pytest.mark.program
def test_the_page_judges_typed_answers_as_python_does():
    drawn = draw_judgements(4_000)
    judged = run_module(JUDGE, "answers.js", [(rules, text) for rules, text, _ in drawn])
    expected = [judgement for _, _, judgement in drawn]
    assert judged == expected
    assert len(set(expected)) == 7


FOLLOW = """
import { Follower } from ADDRESS;
let text = "";
for await (const chunk of process.stdin) text += chunk;
const { script, walks } = JSON.parse(text);
const names = walks.map((walk) => {
  let name = 0, n = 0, at = 1;
  const message = (m) => { if (m.t === "screen") name = m.name; };
  const follower = new Follower(script, null, { message, agreed() {}, settled() {}, picture() {} });
  const receive = (what) => {
    at += 20e6;
    follower.receive({ n: ++n, at, what: { ...what, stamp: at, flip: at, submit: at } });
  };
  return walk.map((what) => {
    receive(what);
    receive({ t: "shown", name, step: -1, episode: -1 });
    return name;
  });
});
console.log(JSON.stringify(names));
"""
SLIDERS = """
[[questions]]
name = "marks"
title = "Marks"

[[questions.items]]
name = "mood"
kind = "slider"
ask = "How are you?"
show_value = true

[[questions.items]]
name = "share"
kind = "slider"
ask = "Which share?"
minimum = -1
maximum = 1
step = 0.003
show_value = true
required = false

[[questions.items]]
name = "luck"
kind = "slider"
ask = "How much luck?"
maximum = 7
"""
SLIDER_KEYS = ("left", "right", "up", "down", "page_up", "page_down", "home", "end")
KEYS = ("enter", "enter", "enter", "enter", "enter", "tab", "page_up", "1", "2", "3", "down", "escape")
TEXTS = ("", " ", "17", "34", "35", "36", "40", "x", "a text that is longer than twenty", '"\u53a8" \\')


def draw_walk(rng: random.Random) -> list[dict[str, Any]]:
    """Draw keys, and texts of either field, from the consent on."""
    enter = [{"t": "key", "key": "enter", "down": down} for down in (True, False)]
    walk: list[dict[str, Any]] = [*enter]
    if rng.random() < 0.7:
        walk += [{"t": "field", "text": "34", "name": "age"}, *enter, *enter]  # to the quiz
    for _ in range(60):
        if rng.random() < 0.4:
            walk.append({"t": "field", "text": rng.choice(TEXTS), "name": rng.choice(("age", "work", "job"))})
        else:
            key = rng.choice(KEYS)
            walk += [{"t": "key", "key": key, "down": True}, {"t": "key", "key": key, "down": False}]
    return walk


def draw_sliders(rng: random.Random) -> list[dict[str, Any]]:
    """Draw a walk through sliders: keys that move a thumb, or lead on and back, presses, and drags."""
    walk: list[dict[str, Any]] = [{"t": "key", "key": "enter", "down": down} for down in (True, False)]
    for _ in range(60):
        if rng.random() < 0.3:
            targets = ("slider", "slider", "slider", "slider", "go_on", "back")
            press = {"t": "pointer", "what": "pressed", "target": rng.choice(targets), "along": rng.random()}
            moves = [press | {"what": "moved", "along": rng.random()} for _ in range(rng.randrange(3))]
            cause = rng.choice(("finger", "finger", "held_before_focus"))
            walk += [press | {"cause": cause}, *moves, press | {"what": "released"}]
        else:
            key = rng.choice((*SLIDER_KEYS, "enter", "enter", "tab", "1", "escape"))
            presses = rng.choice((1, 1, 3))  # a held key repeats
            walk += [{"t": "key", "key": key, "down": True, "repeat": number > 0} for number in range(presses)]
            walk.append({"t": "key", "key": key, "down": False})
    return walk


POINTERS = {"pressed": PointerPressed, "moved": PointerMoved, "released": PointerReleased}


def convert(what: dict[str, Any], at_ns: int) -> Input:
    """Return the session's input for an act of a walk."""
    match what:
        case {"t": "key", "down": True}:
            return KeyDown(at_ns, what["key"], "", what.get("repeat", False))
        case {"t": "key"}:
            return KeyUp(at_ns, what["key"])
        case {"t": "pointer"}:
            return POINTERS[what["what"]](at_ns, 0.5, 0.5, what["target"], what["along"], what.get("cause", "finger"))
    return TextEdited(at_ns, what["text"], field=what["name"])


def name_screens(protocol: Protocol, walk: list[dict[str, Any]]) -> list[int]:
    """Walk through the real session; return the name of the screen after each input."""
    session = build_session(plan_site_session(protocol, 0), PageWorld, collect_machine_facts(), picture_px=(96, 96))
    session.receive(Tick(1))
    at_ns = 1
    names = []
    for what in walk:
        at_ns += 20_000_000
        session.receive(convert(what, at_ns))
        names.append(describe_screen(session, lambda _: 0)[1])
        at_ns += 20_000_000
        session.receive(ScreenShown(at_ns, at_ns, at_ns))
    session.close()
    return names


@needs("node")
@pytest.mark.program
@pytest.mark.parametrize("part", ["quiz", "questions", "sliders", "sliders in Arabic"])
def test_drawn_walks_through_questions_show_the_sessions_screens(tmp_path, part):
    path = write_short(tmp_path)
    draw = draw_walk
    if part != "quiz":
        path.write_text(path.read_text().replace("right = 1", "").replace("only_if = { goal = [3] }", ""))
    if part.startswith("sliders"):
        draw = draw_sliders
        text = path.read_text().replace('parts = ["consent", "about", "quiz"]', 'parts = ["consent", "marks", "quiz"]')
        path.write_text(text + SLIDERS)
    if part == "sliders in Arabic":
        path.write_text(path.read_text().replace("seed = 3", 'seed = 3\nlanguage = "ar"'))
    protocol = read_protocol(path)
    write_site(protocol, tmp_path / "site", slots=1)
    script = json.loads((tmp_path / "site/study/slot-0.json").read_text())
    rng = random.Random(11)
    walks = [draw(rng) for _ in range(count(40, 1_000))]
    followed = run_module(FOLLOW, "follower.js", {"script": script, "walks": walks})
    for walk, names in zip(walks, followed, strict=True):
        assert names == name_screens(protocol, walk)
    assert len({name for names in followed for name in names}) > 30


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
        ('kind = "text"', 'kind = "slider"\nstep = 0.01', "asks 'work' on a slider of more than 2000 steps"),
        ('kind = "number"', 'kind = "slider"\nright = 30', "has a correct answer to 'age', a slider"),
        ("required = false", "only_if = { age = [20] }", "asks 'work' depending on the typed answer 'age'"),
        ("maximum = 99", "maximum = 99\nright = 30", "has a correct answer to 'age', a typed answer"),
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


def test_a_slot_that_many_pages_draw_has_a_code_for_each():
    codes = [format_participant_code(3, before) for before in (0, 9, 10, 400)]
    assert codes == ["sub-04", "sub-900004", "sub-1000004", "sub-40000004"]
    assert {parse_participant_code(code) for code in codes} == {3}
