"""check --pictures: every screen of a study as a participant will see it, without a window."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from minihuman.admin.protocol_file import ProtocolDraft, read_protocol
from minihuman.experiment.machine.screens import PlayScreen, QuestionScreen, TextScreen
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.screenshots import render_screens, save_screenshots

pytestmark = pytest.mark.program
PROTOCOLS = Path(__file__).parents[2] / "protocols"


def test_every_screen_is_drawn_once_and_all_are_on_one_sheet(tmp_path: Path) -> None:
    demo = read_protocol(PROTOCOLS / "demo.toml")
    plan = expand_protocol(demo, enrol_participant(demo, 0))
    screens, missing = render_screens([plan], (640, 360))
    names = [name for name, _ in screens]
    assert missing == ()
    for phase in ("keyboard_check", "instructions", "ready", "grid-playing", "grid-hold", "first-person-playing"):
        assert phase in names
    drawn_all = save_screenshots([plan], tmp_path / "out", (640, 360))
    assert len(drawn_all.screens) == len(names)
    for path in drawn_all.screens:
        with Image.open(path) as image:
            drawn = np.asarray(image)
        assert drawn.shape == (360, 640, 3)
        assert drawn.std() > 1, f"{path.name} is empty"
    assert drawn_all.sheet.name == "contact-sheet.png"
    with Image.open(drawn_all.sheet) as whole:
        assert whole.size[0] == 5 * 328


def test_a_study_with_a_quiz_and_practice_is_seen_to_its_end_and_so_is_what_those_are_told_who_err() -> None:
    study = read_protocol(PROTOCOLS / "two-days.toml")
    screens, missing = render_screens([expand_protocol(study, enrol_participant(study, 0))], (640, 360))
    assert missing == ()
    names = [name for name, _ in screens]
    for phase in ("practice-playing", "rooms-hold", "crossing-playing", "open-playing", "lava-hold", "closing"):
        assert phase in names, f"{phase} is behind a quiz and practice"
    assert {screen.mark for _, screen in screens if isinstance(screen, PlayScreen)} >= {"good", "bad"}
    told = [screen.body for name, screen in screens if name == "feedback" and isinstance(screen, TextScreen)]
    assert len(told) == len({re.sub(r"[\d.]+", "", words) for words in told}), "only what was earned differs"
    assert any(isinstance(screen, TextScreen) and screen.title == "还不完全正确" for _, screen in screens)


def test_all_sessions_are_drawn_and_what_both_days_show_is_drawn_once() -> None:
    toml = ProtocolDraft(name="days", episodes=1, templates=("two-days", "three-groups"), language="he").toml()
    study = decode_protocol(toml.encode())
    who = enrol_participant(study, 0)
    days = [expand_protocol(study, who, session=session) for session in (1, 2)]
    screens, missing = render_screens(days, (640, 360))
    assert missing == ()
    asked = [screen.question for _, screen in screens if isinstance(screen, QuestionScreen)]
    assert len(asked) == len({*asked}) == 7, "the quiz, the opinion, and five questions on the second day"
    assert len([name for name, _ in screens if name == "task-a-playing"]) == 1
    assert all(screen.locale.rtl for _, screen in screens)


OWN_WORLD_BEHIND_A_QUIZ = """
[study]
name = "quiz"
version = "1"
seed = 1
participants = 1
[keys]
pool = ["1", "2", "3"]
[[groups]]
name = "all"
parts = ["quiz", "corridor", "hard", "never"]
[[questions]]
name = "quiz"
on_failure = "end"
items = [{ name = "sum", ask = "1 + 1?", kind = "choice", options = ["1", "2", "3"], right = 2 }]
[[blocks]]
name = "corridor"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 1
actions = ["forward"]
max_steps = 20
[[blocks]]
name = "hard"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 1
actions = ["back"]
max_steps = 2
stop_criterion = { successes = 1, of = 1, otherwise = "end" }
[[blocks]]
name = "never"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 1
actions = ["forward"]
max_steps = 2
"""


def test_a_world_without_a_planner_is_drawn_and_what_is_not_reached_is_named(tmp_path: Path) -> None:
    protocol = tmp_path / "quiz.toml"
    protocol.write_text(OWN_WORLD_BEHIND_A_QUIZ)
    study = read_protocol(protocol)
    screens, missing = render_screens([expand_protocol(study, enrol_participant(study, 0))], (640, 360))
    assert {"corridor-playing", "hard-playing"} <= {name for name, _ in screens}
    assert missing == ("never", "closing")
