"""Previews: the real page of a disposable session, planned as the participant's, framed by the desk alone."""

import os
import signal
from contextlib import closing
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.builder.preview_process import PreviewProcess
from minihuman.builder.preview_server import PreviewRequest, PreviewServer, plan_preview
from minihuman.builder.shipped_studies import ShippedStudy, list_shipped_studies
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.expansion import expand_protocol
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

DESK = "127.0.0.1:9"
QUIZ = """
[study]
name = "quiz"
version = "1"
seed = 4
closing = "Good bye."
[keys]
keyboard_check = false
[[groups]]
name = "all"
parts = ["how", "check", "walk"]
[[pages]]
name = "how"
title = "How it goes"
text = "Walk to the green square."
[[questions]]
name = "check"
return_to = "how"
max_attempts = 2
items = [{ name = "colour", kind = "choice", ask = "Which square?", options = ["green", "red"], right = 1 }]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
"""


@pytest.fixture
def quiz(tmp_path: Path) -> Path:
    path = tmp_path / "quiz.toml"
    path.write_text(QUIZ)
    return path


@pytest.mark.parametrize("study", list_shipped_studies(), ids=lambda study: study.path.stem)
def test_a_part_is_planned_as_in_the_session_of_a_participant_of_its_group(study: ShippedStudy) -> None:
    protocol = study.read()
    path = study.path
    for group in protocol.groups:
        whole, names = plan_preview(protocol, PreviewRequest(str(path), DESK, group=group.name))
        participant = whole.participant
        assert whole == expand_protocol(protocol, participant)
        assert participant.group == group.name
        for name in names:
            cut, _ = plan_preview(protocol, PreviewRequest(str(path), DESK, part=name, group=group.name))
            assert cut.episodes == whole.episodes
            assert [part.name for part in cut.parts] == [name]
            assert cut.parts[0].kind == whole.parts[names.index(name)].kind


def test_questions_that_lead_back_do_so_within_what_is_previewed(quiz: Path) -> None:
    protocol = read_protocol(quiz)
    alone, _ = plan_preview(protocol, PreviewRequest(str(quiz), DESK, part="check"))
    onward, _ = plan_preview(protocol, PreviewRequest(str(quiz), DESK, part="how", onward=True))
    assert alone.parts[0].plan.back_to is None  # type: ignore[attr-defined]
    assert onward.parts[1].plan.back_to == 0  # type: ignore[attr-defined]
    assert [part.name for part in onward.parts] == ["how", "check", "walk", "closing"]


def test_a_part_that_is_not_in_the_session_is_refused_with_the_groups(quiz: Path) -> None:
    with pytest.raises(ProtocolError, match="part 'lost' is not in session 1 of all; add it to the group"):
        plan_preview(read_protocol(quiz), PreviewRequest(str(quiz), DESK, part="lost"))


def test_the_desk_alone_may_frame_a_preview_and_nothing_of_it_is_kept(
    quiz: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with closing(PreviewServer()) as server:
        previews = [server.show(PreviewRequest(str(quiz), DESK, part=part)) for part in ("how", "check")]
        assert len({preview.url for preview in previews}) == 2  # each has an origin of its own
        as_browser = Request(previews[0].url, headers={"Accept-Encoding": "gzip"})
        with urlopen(as_browser) as answer:
            policy = answer.headers["content-security-policy"]
            page = answer.read().decode()
        assert f"frame-ancestors {DESK}" in policy
        assert previews[1].kind == "questions"
        assert page.index("preview_focus.js") < page.index("page.js")  # the form keeps the focus
        trial = server.show(PreviewRequest(str(quiz), DESK, kind="trial"))
        with urlopen(trial.url) as answer:
            assert "preview_focus.js" not in answer.read().decode()
    assert [path for path in tmp_path.rglob("*") if "preview" in path.name] == []


def test_the_process_says_what_is_wrong_with_a_file_and_comes_back_after_a_crash(quiz: Path) -> None:
    with closing(PreviewProcess()) as process:
        assert process.show(PreviewRequest(str(quiz), DESK)).parts == ("how", "check", "walk", "closing")
        quiz.write_text(QUIZ.replace("episodes = 2", "episodes = 0"))
        with pytest.raises(ProtocolError, match=r"blocks\[0\].episodes"):
            process.show(PreviewRequest(str(quiz), DESK))
        quiz.write_text(QUIZ)
        assert process._process is not None
        os.kill(process._process.pid, signal.SIGKILL)
        process._process.wait()
        assert process.show(PreviewRequest(str(quiz), DESK, part="walk")).kind == "play"


@needs("chromium")
@pytest.mark.program
def test_the_preview_has_the_pixels_of_the_session_that_follows(quiz: Path, tmp_path: Path) -> None:
    with (
        closing(PreviewServer()) as server,
        serving(quiz, tmp_path / "data") as served,
        browsing(size=(1280, 720)) as sit_down,
    ):
        addresses = {
            "session": f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}",
            "preview": server.show(PreviewRequest(str(quiz), DESK)).url,
        }
        pictures = {}
        for name, address in addresses.items():
            somebody = sit_down(address)
            somebody.until_seen("s.welcomed && s.kind !== ''")
            shots = [somebody.page.screenshot()]
            somebody.press("enter")
            somebody.page.get_by_text("Which square?").wait_for()
            somebody.until_seen()
            shots.append(somebody.page.screenshot())
            pictures[name] = shots
    assert pictures["preview"] == pictures["session"]
