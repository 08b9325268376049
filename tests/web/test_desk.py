"""The experimenter's start page: what it lists, what its buttons start, who gets in, and how it looks in a browser."""

import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from starlette.testclient import TestClient

from minihuman.admin.next_session import plan_next_session
from minihuman.cli.command_line import make_command_line
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from minihuman.web.server.desk import StartPage, StudyEntry, find_studies
from tests.counts import PATIENCE_S
from tests.lab.test_due import TWO_DAYS
from tests.machine import needs
from tests.programs import running
from tests.web.browser import browsing
from tests.web.test_accessible import serious

TOML = TWO_DAYS.toml.replace(b"[2, 4]", b"[0, 4]")
KEY = "protocols/days.toml"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a protocol, two participants who are due today, and one who never came; beside a broken file."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "protocols").mkdir()
    (folder / KEY).write_bytes(TOML)
    (folder / "broken.toml").write_text("[study\n")
    (folder / "pyproject.toml").write_text("[project]\nname = 'other'\n")
    protocol = decode_protocol(TOML)
    for log in simulate(protocol, folder / "sessions", participants=2, seed=1, player="random"):
        if "ses-02" in log.name:
            shutil.rmtree(log.parent)
    plan_next_session(protocol, folder / "sessions")
    return folder


@pytest.fixture
def page(lab: Path, tmp_path: Path) -> Iterator[TestClient]:
    desk = StartPage(lab, lab / "sessions", tmp_path)
    with TestClient(desk.app(), base_url=f"http://127.0.0.1:8000{desk.path}", follow_redirects=True) as client:
        yield client
    desk.close()


def test_the_page_lists_the_studies_of_a_folder_and_what_is_expected_of_whom(page: TestClient) -> None:
    home = page.get("").text
    assert "days" in home
    assert "broken.toml cannot be read" in home
    assert "other" not in home
    study = page.get(f"study?key={quote(KEY)}").text
    assert study.count("Start session 2") == 2
    assert "due now until" in study
    assert "has a slot and never came" in study
    assert "Start the next participant" in study


def press(page: TestClient, action: str) -> str:
    """Press a study's button, and wait until its command has ended; the page of the command."""
    shown = page.post("start", data={"study": KEY, "action": action})
    deadline_s = time.monotonic() + PATIENCE_S
    while "data-running" in shown.text:
        assert time.monotonic() < deadline_s
        time.sleep(0.2)
        shown = page.get(str(shown.url))
    return shown.text


def test_a_button_starts_the_command_and_shows_what_it_printed(page: TestClient) -> None:
    shown = press(page, "check")
    assert '<strong class="done">done</strong>' in shown
    assert "study        days" in shown
    assert "minihuman check" in shown
    assert '<span class="done">done</span>' in page.get(f"study?key={quote(KEY)}").text


def test_a_report_that_could_not_be_written_anew_says_why_beside_the_old_one(page: TestClient, lab: Path) -> None:
    old = lab / "reports" / "days"
    old.mkdir(parents=True)
    (old / "report.html").write_text("<p>of yesterday</p>")
    (old / "figures").touch()  # where a folder has to be
    try:
        assert '<strong class="refused">refused</strong>' in press(page, "report")
        study = page.get(f"study?key={quote(KEY)}").text
        assert "Open the report" in study
        assert '<span class="refused">refused</span>' in study
        assert "reports/days/figures" in study
    finally:
        shutil.rmtree(lab / "reports")


def test_others_do_not_get_in(page: TestClient) -> None:
    assert page.get("", headers={"host": "evil.example"}).status_code == 400
    assert page.get("http://127.0.0.1:8000/").status_code == 404
    assert page.get("http://127.0.0.1:8000/x/study?key=days").status_code == 404
    assert page.get("reports/../../protocols/days.toml").status_code == 404
    assert page.get("study?key=../days.toml").status_code == 404
    assert page.get("process/7").status_code == 404
    assert page.post("start", data={"study": KEY, "action": "rm"}).status_code == 400
    policy = page.get("").headers["content-security-policy"]
    assert "default-src 'self'" in policy


def test_every_button_is_a_command_that_the_command_line_takes() -> None:
    study = StudyEntry(KEY, "days", Path("sessions/days"), Path(KEY))
    form = {"participant": "sub-02", "session": "2", "reason": "they were ill", "links": "3", "windowed": "1"}
    buttons = ("next", "session", "other day", "replace", "check", "trust", "doctor", "serve", "watch", "verify")
    for action in (*buttons, "report"):
        name, *words = study.command(action, form)
        command = make_command_line().get_command(None, name)  # type: ignore[arg-type] # it needs none
        assert command is not None
        command.make_context(name, list(words))
    assert "--participant=sub-02" in study.command("session", form)
    with pytest.raises(KeyError):
        StudyEntry("days/", "days", Path("sessions/days")).command("next", form)


def test_sessions_without_a_protocol_are_a_study_to_look_at(lab: Path, tmp_path: Path) -> None:
    (found,) = find_studies(tmp_path, lab / "sessions")
    assert (found.key, found.name, found.protocol) == ("days/", "days", None)


@pytest.mark.program
@needs("chromium")
def test_in_a_browser_it_checks_watches_and_has_no_serious_finding(lab: Path) -> None:
    command = [sys.executable, "-m", "minihuman", "desk", str(lab), "--data", str(lab / "sessions"), "--no-browser"]
    with running(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        address = program.stdout.readline().split()[1]
        with browsing() as sit_down:
            somebody = sit_down(address)
            page = somebody.page
            assert serious(page) == []
            page.get_by_role("link", name="days", exact=True).click()
            assert serious(page) == []
            page.get_by_role("button", name="Watch sessions").click()
            page.get_by_role("link", name="http://127.0.0.1").wait_for()  # the page asks until it is there
            assert serious(page) == []
            page.get_by_role("button", name="Stop").click()
            page.get_by_text("ended", exact=True).wait_for()
            assert somebody.errors == []
        program.send_signal(signal.SIGTERM)
        assert program.wait(timeout=PATIENCE_S) in (0, -signal.SIGTERM)
