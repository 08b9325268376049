"""A laboratory adds an activity, a question kind, an exporter and a column: one folder, no edit elsewhere."""

import json
import os
import re
import shutil
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

import minihuman
from minihuman.activities.questions.question import find_question_kind
from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.activity_tables import list_activity_tables
from minihuman.dataset.table_catalogue import TABLES
from minihuman.display.drawing.screen import compose_screen
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.events import Answered
from minihuman.experiment.machine.inputs import PointerPressed
from minihuman.experiment.machine.screens import TextLocale
from minihuman.experiment.plan.dry_run import list_missing_words
from minihuman.experiment.plan.protocol_notices import list_protocol_notices
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.codec import find_topic, list_activity_topics
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.template import format_number
from minihuman.simulation.model_conversation import find_answer_rule, list_inputs
from minihuman.testing import check_activity, check_exporter, check_question
from minihuman.web.screen_values import convert_screen
from minihuman.web.server.page_routes import build_page_routes
from tests.machine import needs
from tests.study.sessions import Desk
from tests.study.studies import plan_of
from tests.web.browser import browsing
from tests.web.serving import serving

pytestmark = pytest.mark.program  # a study is simulated

FOLDER = Path(__file__).parent / "dummy_lab"
ENTRY_POINTS = """
[minihuman.activities]
tapping = dummy_lab.activity:TAPPING
[minihuman.questions]
mood = dummy_lab.mood:MOOD
wishes = dummy_lab.wishes:WISHES
affect = dummy_lab.affect:AFFECT
shares = dummy_lab.shares:SHARES
[minihuman.exporters]
lengths = dummy_lab.lengths:export_lengths
[minihuman.columns]
hesitation_ms = dummy_lab.columns:HESITATION
"""
HEAD = """
[study]
name = "dummy"
version = "1"
seed = 3
closing = ""
[keys]
keyboard_check = false
"""
CANVASES = """
[[questions.items]]
name = "state"
kind = "affect"
ask = "How are you?"
[[questions.items]]
name = "coins"
kind = "shares"
ask = "Whose are they?"
statements = { mine = "me", theirs = "them" }
"""
PHONE_STUDY = """
[web]
require_keyboard = false
[[groups]]
name = "all"
parts = ["q"]
[[questions]]
name = "q"
"""
STUDY = f"""
{HEAD}
[[groups]]
name = "all"
parts = ["warm-up", "feelings", "played"]
[[activities]]
name = "warm-up"
kind = "tapping"
settings = {{ taps = 4 }}
[[questions]]
name = "feelings"
[[questions.items]]
name = "feeling"
kind = "mood"
ask = "How do you feel now?"
[[questions.items]]
name = "wishes"
kind = "wishes"
ask = "What do you want, first things first?"
options = ["rest", "food", "drink"]
{CANVASES}
[[blocks]]
name = "played"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
episodes = 2
max_steps = 9
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The folder that the laboratory's package is installed in, in a process that met its names before it was there."""
    assert list_activity_topics(["tapping"]) == ()
    assert find_topic("/dummy_lab/tap") is None
    place = tmp_path_factory.mktemp("installed")
    shutil.copytree(FOLDER, place / "dummy_lab", ignore=shutil.ignore_patterns("__pycache__"))
    info = place / "dummy_lab-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: dummy-lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(place)
        patch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)  # of the processes that read the logs
        yield place
    for name in [name for name in sys.modules if name.partition(".")[0] == "dummy_lab"]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def study(lab, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    protocol = folder / "dummy.toml"
    protocol.write_text(STUDY)
    list(minihuman.simulate(protocol, participants=2, data=folder, player="random", seed=1))
    return folder / "dummy"


def test_the_kinds_keep_their_contracts(lab):
    check_activity("tapping", taps=3)
    check_question("mood")
    check_question(
        "mood", settings={"colours": {"low": "#000000", "middle": "#808080", "high": "#ffffff"}}, right="low"
    )
    check_question("wishes")
    check_question("affect")
    check_question("affect", settings={"size": 5})
    check_question("shares")
    check_exporter("lengths")


def test_its_events_are_in_the_log_which_proves(study):
    logs = sorted(study.rglob("*.mcap"))
    taps = [event.tap for log in logs for event in read_log(log).part_events if type(event).__name__ == "Tapped"]
    assert taps == [1, 2, 3, 4] * 2
    findings = list(minihuman.verify(study))
    assert len(findings) == 2
    assert all(finding.ok for finding in findings)


def test_its_events_and_answers_are_rows_of_tables(study):
    tables = minihuman.open_study(study)
    taps = tables.table("taps")
    assert list(taps["tap"]) == [1, 2, 3, 4] * 2
    assert list(taps["part"]) == [1] * 8
    answers = tables.table("answers")
    assert set(answers["answer"][answers["item"] == "feeling"]) <= {"sad", "glad"}
    assert all(sorted(json.loads(order)) == [1, 2, 3] for order in answers["answer"][answers["item"] == "wishes"])
    assert set(answers["item"][answers["kind"] == "affect"]) == {"state_pleasure", "state_arousal"}
    coins = answers[answers["kind"] == "shares"]
    assert set(coins["item"]) == {"coins_mine", "coins_theirs"}
    assert set(coins.groupby("participant")["number"].sum()) == {3}
    assert "taps" in {table.name for table in list_activity_tables()}


def test_its_column_is_in_the_table_of_episodes_and_explained(study):
    episodes = minihuman.open_study(study).table("episodes")
    assert (episodes["hesitation_ms"] > 0).all()
    assert TABLES["episodes"][-1].meaning.startswith("From the reset to the first step")


def test_its_tables_and_its_exporter_write_files(study, tmp_path):
    minihuman.export("csv", study, tmp_path / "csv")
    assert "taps.csv" in {path.name for path in (tmp_path / "csv").rglob("*.csv")}
    minihuman.export("lengths", study, tmp_path / "lengths")
    assert (tmp_path / "lengths" / "lengths.txt").read_text().split()


def test_its_section_is_in_the_report(study, tmp_path):
    minihuman.report(study, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text()
    assert '<h2 id="tapping">Tapping</h2>' in page
    assert "Taps of the space bar." in page
    answers = minihuman.open_study(study).table("answers")
    for name in ("state_pleasure", "state_arousal", "coins_mine", "coins_theirs"):
        numbers = answers["number"][answers["item"] == name]
        assert re.search(rf">(?:<bdi>)?{name}(?:</bdi>)?</td>.*?mean {format_number(numbers.mean())}, ", page)


def test_its_screen_is_drawn_at_the_desk_and_described_to_the_page(lab):
    screen = find_kind("tapping").screens[0](TextLocale(), taps=2)
    before = find_kind("tapping").screens[0](TextLocale(), taps=0)
    assert not np.array_equal(compose_screen(screen, (320, 240)), compose_screen(before, (320, 240)))
    values = convert_screen(screen, lambda _: 0)
    assert msgspec.json.decode(msgspec.json.encode(values)) == values
    assert (values["kind"], values["view"], values["taps"]) == ("activity", "taps", 2)


def test_the_page_finds_its_module(lab):
    values = convert_screen(find_kind("tapping").screens[0](TextLocale(), taps=2), lambda _: 0)
    with TestClient(Starlette(routes=build_page_routes())) as client:
        answer = client.get(values["module"])
    assert answer.headers["content-type"].startswith("text/javascript")
    assert answer.text == (FOLDER / "page.js").read_text()


def ask_mood(language: str, words: str = "") -> Desk:
    item = '[[questions]]\nname = "q"\n[[questions.items]]\nname = "a"\nkind = "mood"\nask = "?"\n'
    return Desk(plan_of(f"{words}{item}", ["q"], language=language))


@pytest.mark.parametrize(
    ("language", "prompt", "note"),
    [
        ("en", "Click on a colour, then press Enter", "Please choose one of 2 colours."),
        ("de", "Eine Farbe anklicken, dann Eingabetaste", "Bitte eine von 2 Farben wählen."),
        ("ar", "انقر على لون، ثم اضغط على مفتاح الإدخال", "Please choose one of 2 colours."),  # it lacks the note
        ("fr", "Click on a colour, then press Enter", "Please choose one of 2 colours."),  # it lacks both
    ],
)
def test_its_words_are_those_of_the_studys_language_and_english_where_it_lacks_them(lab, language, prompt, note):
    desk = ask_mood(language)
    assert desk.session.screen.prompt == prompt
    desk.press("enter")
    assert desk.session.screen.note == note
    if language != "en":  # the log holds every word of such a study
        assert desk.session.plan.words["prompt.mood"] == prompt


def test_a_study_may_replace_its_words(lab):
    desk = ask_mood("de", '[words.prompt]\nmood = "Farbe!"\n[words.note]\nmood = "Eine!"\n')
    assert desk.session.screen.prompt == "Farbe!"
    desk.press("enter")
    assert desk.session.screen.note == "Eine!"


def test_check_names_the_words_that_its_language_lacks(lab):
    protocol = decode_protocol(STUDY.replace("seed = 3", 'seed = 3\nlanguage = "ar"').encode())
    assert list(list_missing_words(protocol)) == [
        "language 'ar' has no word for prompt.wishes, so English stands in; add wishes to [words.prompt]",
        "language 'ar' has no word for note.mood, so English stands in; add mood to [words.note]",
    ]


def test_its_colours_are_drawn_and_kept_when_chosen(lab):
    desk = ask_mood("en")
    for key in ("", "1"):
        if key:
            desk.press(key)
        picture = compose_screen(desk.session.screen, (640, 360)).reshape(-1, 3)
        colours = {"#" + bytes(colour).hex() for colour in np.unique(picture, axis=0).astype(np.uint8)}
        assert {"#2266cc", "#ffee55"} <= colours


def ask(item: str) -> Desk:
    return Desk(plan_of(f'[[questions]]\nname = "q"\n[[questions.items]]\nname = "a"\nask = "?"\n{item}', ["q"]))


SHARES = 'kind = "shares"\nstatements = { mine = "me", theirs = "them" }\n'


def click(desk: Desk, *targets: str) -> None:
    for target in targets:
        desk.now_ns += 1
        desk.give(PointerPressed(desk.now_ns, 0.5, 0.5, target, 0.5))


@pytest.mark.parametrize(
    ("item", "targets", "given"),
    [
        ('kind = "affect"', ["cell:1:2", "cell:3:2"], {"a_pleasure": "3", "a_arousal": "2"}),
        (SHARES, ["share:0", "share:1", "share:0"], {"a_mine": "2", "a_theirs": "1"}),
    ],
)
def test_each_answer_of_a_question_is_logged_by_its_own_name(lab, item, targets, given):
    desk = ask(item)
    click(desk, *targets, "go_on")
    assert {event.item: event.value for event in desk.of(Answered)} == given


@pytest.mark.parametrize(
    ("item", "names"),
    [
        ('kind = "affect"\nsettings = { size = 1 }', ["pleasure 1, arousal 1"]),
        (SHARES, ["a point for me", "a point for them"]),
    ],
)
def test_a_shape_is_called_by_its_name_where_it_is_not_seen(lab, item, names):
    screen = ask(item).session.screen
    assert screen.item.description.splitlines() == [f"{number}. {name}" for number, name in enumerate(names, 1)]
    shapes = convert_screen(screen, lambda _: 0)["item"]["shapes"]
    assert [shape["accessible_name"] for shape in shapes if shape["target"]] == names


@needs("chromium")
def test_a_canvas_keeps_its_shape_on_a_phone(lab, tmp_path):
    path = tmp_path / "canvases.toml"
    path.write_text(f"{HEAD}{PHONE_STUDY}{CANVASES}")
    with serving(path, tmp_path) as served, browsing(size=(390, 844)) as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}", has_touch=True, is_mobile=True)
        person.until_seen("document.querySelector('#ask')?.textContent === 'How are you?'")
        cells = [cell.bounding_box() for cell in person.page.get_by_role("radio").all()]
        first = cells[0]
        assert [cell["width"] for cell in cells] == pytest.approx([first["height"]] * 9, abs=1)
        assert [cell["x"] for cell in cells[:3]] == pytest.approx(
            [first["x"] + n * first["width"] for n in range(3)], abs=1
        )
        person.page.get_by_role("radio", name="pleasure 3, arousal 1").click()
        person.until("document.querySelector('.shape.chosen')?.dataset.target === 'cell:3:1'")
        person.press("enter")
        person.until_seen("document.querySelector('#ask')?.textContent === 'Whose are they?'")
        assert person.errors == []


def test_the_contract_warns_of_shapes_without_a_name(lab, monkeypatch):
    kind = find_question_kind("affect")
    monkeypatch.setattr(sys.modules[kind.components.__module__], "describe", lambda cell: "")
    with pytest.warns(FutureWarning, match="9 shapes have no name, the first with the target 'cell:1:3'; give each"):
        check_question("affect")


def test_a_stratum_or_a_right_answer_is_one_answer(lab):
    for name, answers in (("state", "state_pleasure, state_arousal"), ("coins", "coins_mine, coins_theirs")):
        with pytest.raises(ProtocolError, match=rf"has several answers \({answers}\); use a question with one answer"):
            decode_protocol(f'{STUDY}[allocation]\nstratify_by = "feelings.{name}"\n'.encode())
    with pytest.raises(
        ProtocolError, match=r"right.* is one answer, but the question has 2: a_mine, a_theirs; remove it"
    ):
        ask(f"{SHARES}right = 3")


def test_a_mistake_in_its_words_is_named(lab, monkeypatch):
    monkeypatch.syspath_prepend("beside")  # so that nothing is remembered
    path = lab / "dummy_lab" / "words.toml"
    sound = path.read_text()
    try:
        path.write_text("[en.prompt]\nmood = 3\n")
        with pytest.raises(
            ProtocolError, match=r"words.toml of question kind 'mood': en.prompt.mood is 3; write a text"
        ):
            ask_mood("en")
    finally:
        path.write_text(sound)


def test_a_right_code_is_one_of_its_own(lab):
    with pytest.raises(ProtocolError, match=r"right.* is 'blue', which is not an option's code; codes: sad, glad"):
        decode_protocol(STUDY.replace('kind = "mood"', 'kind = "mood"\nright = "blue"').encode())
    with pytest.raises(ProtocolError, match=r"options.* is given, but a question of kind 'mood' has its own; give"):
        decode_protocol(STUDY.replace('kind = "mood"', 'kind = "mood"\noptions = ["a", "b"]').encode())


@pytest.mark.parametrize(("keys", "right"), [("213", True), ("123", False)])
def test_an_order_is_right_in_its_order_alone(lab, keys, right):
    items = 'name = "a"\nkind = "wishes"\nask = "?"\noptions = ["x", "y", "z"]\nright = [2, 1, 3]\n'
    desk = Desk(plan_of(f'[[questions]]\nname = "q"\n[[questions.items]]\n{items}', ["q"]))
    desk.press(*keys, "enter")
    [given] = desk.of(Answered)
    assert (given.value, given.right) == (f"[{','.join(keys)}]", right)


def test_a_language_model_gives_an_order_in_its_order(lab):
    items = 'name = "a"\nkind = "wishes"\nask = "?"\noptions = ["x", "y", "z"]\n'
    desk = Desk(plan_of(f'[[questions]]\nname = "q"\n[[questions.items]]\n{items}', ["q"]))
    rule = find_answer_rule(desk.session.screen, desk.session)
    assert rule.request.startswith("Answer with the numbers of all wishes, the dearest first.")
    for happened in list_inputs(rule.read("3, 1, 2"), rule, 1_000):
        desk.give(happened)
    assert desk.of(Answered)[0].value == "[3,1,2]"


def test_a_kind_that_uses_no_field_of_others_has_each_named(lab):
    study = decode_protocol(STUDY.replace('kind = "mood"', 'kind = "mood"\nlow = "bad"').encode())
    [notice] = list_protocol_notices(study)
    assert notice.endswith("of kind 'mood', which uses none of the fields of other kinds")


def test_a_protocol_may_name_them(lab, tmp_path):
    path = tmp_path / "dummy.toml"
    path.write_text(STUDY)
    assert read_protocol(path).activities[0].kind == "tapping"


def test_nothing_of_the_package_knows_them():
    package = Path(minihuman.__file__).parent
    sources = [path for path in package.rglob("*") if path.suffix in (".py", ".js", ".toml")]
    for name in ("dummy_lab", "prompt.mood", "prompt.wishes", "prompt.affect"):
        assert [path for path in sources if name in path.read_text(encoding="utf-8")] == []
