"""Sites of questions that save to DataPipe and to JATOS: stand-ins of them, and a person in Chromium."""

from pathlib import Path
from typing import Any

import pytest

import minihuman
from minihuman import study_site
from minihuman.admin.protocol_file import read_protocol
from minihuman.web.site.site_folder import write_site
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.site.collectors import EXPERIMENT, running_datapipe, running_jatos
from tests.web.site.static_site import READ_ARCHIVE, hosting

ONLINE = Path(__file__).parents[3] / "protocols" / "online.toml"

PROTOCOL = """
[study]
name = "short"
version = "1"
seed = 3
participants = 4
closing = "That was all."

[web.completion_codes]
complete = "C0DE"

[[pages]]
name = "consent"
title = "Consent"
asks_consent = true
text = "There are a few questions."

[[groups]]
name = "one"
parts = ["consent", "about", "quiz"]

[[questions]]
name = "about"
title = "About you"

[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
minimum = 18
maximum = 99

[[questions.items]]
name = "work"
kind = "text"
ask = "What is your work?"
longest = 20
required = false

[[questions]]
name = "quiz"
title = "The rules"
max_attempts = 3
wrong_answer_text = "That was not right."

[[questions.items]]
name = "goal"
kind = "choice"
ask = "Where do you go?"
options = ["to the square", "to the wall", "nowhere"]
right = 1

[[questions.items]]
name = "why"
kind = "choice"
ask = "Why nowhere?"
options = ["I am tired", "It is late"]
only_if = { goal = [3] }
"""


def make_site(folder: Path, collector: str) -> tuple[Path, Path]:
    protocol = folder / "short.toml"
    protocol.write_text(PROTOCOL, encoding="utf-8")
    write_site(read_protocol(protocol), folder / "site", collector=collector, slots=4)
    return protocol, folder / "site"


class Answerer:
    """A person who answers the questions."""

    def __init__(self, person: Any) -> None:
        self.person = person
        self._keyboard = person.page.keyboard

    def answer(self, words: str, *keys: str, text: str = "") -> None:
        """Wait for words on the screen, type a text, and press keys."""
        self.person.until_seen(f"s.welcomed && document.querySelector('#screen').innerText.includes({words!r})")
        if text:
            self._keyboard.press("Control+A")
            self._keyboard.type(text)
        for key in keys:
            self._keyboard.press(key)

    def answer_all(self) -> None:
        """Give ages that are none, come back to texts, and fail the quiz once."""
        self.answer("a few questions", "Enter")
        self.answer("How old are you?", "Enter", text="seven")
        self.answer("whole number", "Enter", text="17")
        self.answer("18 to 99", "Enter", text="34")
        self.answer("What is your work?", "PageUp", text='"Köchin" \\ 厨师')
        self.answer("How old are you?")
        assert self.person.page.locator("[data-target=field]").input_value() == "34"
        self.answer("How old are you?", "Enter", text="35")
        self.answer("What is your work?")
        assert self.person.page.locator("[data-target=field]").input_value() == '"Köchin" \\ 厨师'
        self.answer("What is your work?", "Enter")
        self.answer("Where do you go?", "3", "Enter")
        self.answer("Why nowhere?", "2", "Enter")
        self.answer("That was not right.", "Enter")
        self.answer("Where do you go?", "1", "Enter")
        self.answer("That was all.", "Enter")


def import_answers(folder: Path, data: Path, protocol: Path) -> tuple[Any, dict[str, str]]:
    """Import one record; return it and the last answers."""
    (imported,) = study_site.import_site_data(folder, study=data / "short", protocol=protocol)
    assert imported.error is None
    assert imported.differences == ()
    assert all(line.ok for line in minihuman.verify(data / "short"))
    answers = minihuman.open_study(data / "short").table("answers", with_excluded=True)
    return imported, answers.groupby("item").answer.last().to_dict()


@needs("chromium")
@pytest.mark.program
def test_a_record_reaches_datapipe_once_though_an_answer_is_lost(tmp_path):
    protocol, site = make_site(tmp_path, f"datapipe:{EXPERIMENT}")
    script = site / "static" / "collectors.js"
    with running_datapipe(lost_answers=1) as pipe, hosting(site) as host, browsing() as sit_down:
        script.write_text(script.read_text().replace("https://pipe.jspsych.org/api/data/", pipe.address))
        person = sit_down(host.address)
        Answerer(person).answer_all()
        person.until("s.finished")
        assert "C0DE" in person.page.locator("body").inner_text()
        assert set(pipe.answers) == {"Success"}
        assert len(pipe.answers) > 2  # the lost one, and one after each part
        folder = pipe.write_files(tmp_path / "files")
    _, answers = import_answers(folder, tmp_path, protocol)
    assert answers == {"age": "35", "work": '"Köchin" \\ 厨师', "goal": "1", "why": "2"}


@pytest.mark.nightly
@needs("chromium")
@pytest.mark.program
def test_a_component_of_jatos_takes_the_record_and_ends(tmp_path):
    protocol, site = make_site(tmp_path, "jatos")
    with running_jatos(site) as run, browsing() as sit_down:
        person = sit_down(f"{run.address}?slot=3")
        Answerer(person).answer_all()
        person.until("s.finished")
        person.page.wait_for_function("document.body.innerText.includes('C0DE')")
        assert (run.state, run.message) == ("finished", "complete")
        folder = run.write_results(tmp_path / "results")
    imported, answers = import_answers(folder, tmp_path, protocol)
    assert answers["age"] == "35"
    assert "sub-03" in str(imported.log)


@needs("chromium")
@pytest.mark.program
@pytest.mark.nightly
def test_a_collector_that_refuses_leaves_the_record_with_the_participant(tmp_path):
    protocol, site = make_site(tmp_path, f"datapipe:{EXPERIMENT}")
    script = site / "static" / "collectors.js"
    with running_datapipe(max_sessions=0) as pipe, hosting(site) as host, browsing() as sit_down:
        script.write_text(script.read_text().replace("https://pipe.jspsych.org/api/data/", pipe.address))
        person = sit_down(host.address)
        with person.page.expect_download() as download:
            Answerer(person).answer_all()
        person.until("s.finished")
        assert "C0DE" in person.page.locator("body").inner_text()
        (tmp_path / "files").mkdir()
        download.value.save_as(tmp_path / "files" / "record.json")
    assert set(pipe.answers) == {"SESSION_LIMIT_REACHED"}
    _, answers = import_answers(tmp_path / "files", tmp_path, protocol)
    assert answers["why"] == "2"


@needs("chromium")
@pytest.mark.program
@pytest.mark.nightly
def test_who_declines_leaves_nothing_with_jatos(tmp_path):
    _, site = make_site(tmp_path, "jatos")
    with running_jatos(site) as run, browsing() as sit_down:
        person = sit_down(run.address)
        Answerer(person).answer("a few questions")
        person.page.locator("[data-target=decline]").click()
        person.until("s.finished")
        person.page.wait_for_timeout(500)
    assert (run.state, run.result_data) == ("aborted", "")


@needs("chromium")
@pytest.mark.program
@pytest.mark.nightly
def test_the_online_study_asks_about_its_participants_without_a_server(tmp_path):
    protocol = ONLINE
    write_site(read_protocol(protocol), tmp_path / "site", slots=1)
    with hosting(tmp_path / "site") as host, browsing() as sit_down:
        person = sit_down(host.address)
        answerer = Answerer(person)
        answerer.answer("red box", "Enter")
        answerer.answer("How old are you?", "Enter", text="5")
        answerer.answer("18 to 120", "Enter", text="41")
        for words, key in (("gender", "1"), ("hand", "2"), ("video games", "3"), ("vision", "1")):
            answerer.answer(words, key, "Enter")
        person.until_seen("!document.querySelector('#screen').innerText.includes('vision')")
        assert not person.errors
        host.posted.append(person.page.evaluate(READ_ARCHIVE.replace("thin", "online")))
        folder = host.write_posted(tmp_path / "parts")
    (imported,) = study_site.import_site_data(folder, study=tmp_path / "online", protocol=protocol)
    assert (imported.error, imported.differences) == (None, ())
    answers = minihuman.open_study(tmp_path / "online").table("answers", with_excluded=True)
    given = answers.groupby("item").answer.last().to_dict()
    assert given == {"age": "41", "gender": "woman", "handedness": "left", "gaming": "weekly", "vision": "normal"}
