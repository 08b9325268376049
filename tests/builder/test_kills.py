"""What is killed while a study is edited, a browser or the desk, loses nothing that the page had said is saved."""

import json
import os
import re
import signal
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.error import URLError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

import pytest

from tests.builder.hand import Hand, open_desk
from tests.builder.test_document import ROOT
from tests.machine import needs
from tests.warm_start import start_program
from tests.web.browser import browsing

KEY = "online.toml"
PART = f"#/study/{KEY}/parts/practice"
MOST_EDITS = 10_000
N_ANSWERED = 3  # edits, before the desk is killed during those that follow


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder with a protocol."""
    (tmp_path / KEY).write_bytes((ROOT / "protocols" / KEY).read_bytes())
    return tmp_path


def ask(address: str, name: str, body: Any = None) -> Any:
    """Send a request of the builder's page, and return its answer."""
    content = None if body is None else json.dumps(body).encode()
    headers = {"content-type": "application/json", "sec-fetch-site": "same-origin"}
    with urlopen(Request(f"{address}api/{name}?{urlencode({'key': KEY})}", content, headers)) as answer:
        return json.load(answer)


class Editor:
    """Gives a study one seed after the other, until the desk does not answer any more.

    Attributes:
        documents: the answers.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.documents: list[Any] = [ask(address, "study")]

    def run(self) -> None:
        """Edit until an edit is not answered."""
        for seed in range(MOST_EDITS):
            edit = {"op": "set", "path": ["study", "seed"], "value": seed}
            try:
                self.documents.append(
                    ask(self.address, "edit", {"version": self.documents[-1]["version"], "edits": [edit]})
                )
            except (URLError, OSError):
                return


def kill_desk_during_edits(folder: Path) -> Editor:
    """Kill a desk while a study is edited; return what it had answered."""
    with start_program("desk", str(folder), "--data", str(folder / "sessions"), "--no-browser") as desk:
        try:
            assert desk.stdout is not None
            address = re.search(r"http://\S+", desk.stdout.readline())
            assert address is not None
            editor = Editor(f"{address[0]}builder/")
            thread = Thread(target=editor.run)
            thread.start()
            while len(editor.documents) <= N_ANSWERED:
                thread.join(0.01)
                assert thread.is_alive()
        finally:
            desk.kill()
        thread.join()
    return editor


def test_a_desk_that_is_killed_leaves_the_last_edit_that_it_answered_or_the_one_after_it(lab: Path) -> None:
    editor = kill_desk_during_edits(lab)
    texts = [document["text"] for document in editor.documents]
    last_seed = editor.documents[-1]["tree"]["study"]["seed"]
    text = (lab / KEY).read_text()
    assert text in (texts[-1], texts[-1].replace(f"seed = {last_seed}\n", f"seed = {last_seed + 1}\n"))
    for path in lab.iterdir():  # at most the hidden file that the desk was writing
        if path.is_file() and path.name != KEY:
            assert re.fullmatch(rf"\.{re.escape(KEY)}\.\d+\.unfinished", path.name)
            os.utime(path, (0, 0))  # long ago
    with open_desk(lab) as address:
        document = ask(address, "study")
        assert document["can_undo"]
        while document["can_undo"]:
            document = ask(address, "undo", {"version": document["version"]})
        assert document["text"] == texts[0]
        document = ask(address, "redo", {"version": document["version"]})
        assert document["text"] == texts[1]
    assert [path.name for path in lab.iterdir() if path.is_file()] == [KEY]  # nothing half written beside it


def kill_renderers(page: Any) -> None:
    """Kill the processes that show the pages of a browser."""
    session = page.context.browser.new_browser_cdp_session()
    for process in session.send("SystemInfo.getProcessInfo")["processInfo"]:
        if process["type"] == "renderer":
            os.kill(process["id"], signal.SIGKILL)


@needs("chromium")
@pytest.mark.program
def test_a_browser_that_is_killed_leaves_what_was_saved_and_another_one_goes_on(lab: Path) -> None:
    with open_desk(lab) as address, browsing(size=(1440, 900)) as sit_down:
        page = sit_down(address + PART).page
        hand = Hand(page)
        hand.type(page.get_by_label("Instructions", exact=True), "This is saved.")
        hand.wait_until_saved()
        saved = (lab / KEY).read_text()
        page.route("**/api/edit?*", lambda route: None)  # the next edit does not leave the browser
        hand.type(page.get_by_label("Instructions", exact=True), "This is on its way.")
        hand.page.get_by_role("status").filter(has_text="Saving …").wait_for()
        with page.expect_event("crash"):
            kill_renderers(page)
        assert (lab / KEY).read_text() == saved
        other = Hand(sit_down(address + PART).page)
        instructions = other.page.get_by_label("Instructions", exact=True)
        instructions.wait_for()
        assert instructions.input_value() == "This is saved."
        other.button("Undo").click()
        other.wait_until_saved()
        other.button("Undo").and_(other.page.locator(":disabled")).wait_for()
    assert (lab / KEY).read_bytes() == (ROOT / "protocols" / KEY).read_bytes()
