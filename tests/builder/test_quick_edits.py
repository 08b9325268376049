"""Two edits in quick succession: the second is made before the server has answered the first, and both are kept."""

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.builder.hand import Hand, at_the_page
from tests.machine import needs

pytestmark = [needs("chromium"), pytest.mark.program]
STUDY = """
study = { name = "quick", version = "1", seed = 4 }
keys = { keyboard_check = false }

[[groups]]
name = "a"
parts = ["how", "ask", "cook"]
replace_parts = {}

[[groups]]
name = "b"
parts = ["how", "cook"]

[[pages]]
name = "how"
text = "Cook."

[[questions]]
name = "ask"
items = [{ name = "who", kind = "choice", ask = "Who?", options = ["one", "two", "three"] }]

[[blocks]]
name = "cook"
kind = "team"
world = "minihuman/Team-CrampedRoom-v0"
episodes = 2
actions = ["up", "down", "interact"]
max_steps = 20
pace = "real_time"
step_period_ms = 150
key_map = "fixed"
fixed_keys = { up = "up", down = "down", space = "interact" }
team = { seats = ["person", "person"], partner_leaves = "agent", stand_in = "scripted:cook" }
"""


class Gate:
    """Holds back the edits that a page sends.

    Args:
        page: the page of a browser.
    """

    def __init__(self, page: Any) -> None:
        self._waiting: list[Any] = []
        self._is_open = True
        for request in ("edit", "table"):
            page.route(f"**/api/{request}?*", self._handle)

    def _handle(self, route: Any) -> None:
        if self._is_open or route.request.method == "GET":
            route.continue_()
        else:
            self._waiting.append(route)

    @contextmanager
    def closed(self, hand: Hand) -> Iterator[None]:
        """Hold edits until the block ends; then wait until all are saved."""
        self._is_open = False
        yield
        (first,) = self._waiting  # the others wait on the page for its answer
        self._is_open = True
        self._waiting.clear()
        first.continue_()
        hand.wait_until_saved()


def read(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "study.toml").read_text())


def test_two_quick_edits_of_a_list_a_map_or_the_line_of_parts_are_both_kept(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    with at_the_page(tmp_path) as (hand, address):
        page = hand.page
        gate = Gate(page)
        page.goto(f"{address}#/study/study.toml/parts/ask")
        page.get_by_role("button", name="Who?").click()
        with gate.closed(hand):
            hand.button("Remove one").click()
            hand.button("Remove two").click()
        with gate.closed(hand):
            hand.type(page.get_by_label("Options", exact=True), "four")
            hand.button("Move four earlier").click()
        with gate.closed(hand):
            for kind in ("Text", "Slider"):
                page.get_by_role("region", name="Questions").get_by_role("button", name=kind, exact=True).click()
        page.get_by_role("list", name="Parts of a").locator(".name", has_text="how").click()
        with gate.closed(hand):
            for _ in range(2):
                hand.button("Move how later in a").click()
        with gate.closed(hand):
            for _ in range(2):
                page.get_by_role("article", name="Part how").get_by_role("button", name="Copy").click()
        page.goto(f"{address}#/study/study.toml/parts/cook")
        with gate.closed(hand):
            hand.type(page.get_by_label("Fixed keys: up"), "down")
            hand.type(page.get_by_label("Fixed keys: down"), "up")
        with gate.closed(hand):
            for seat in ("Seat 1", "Seat 2"):
                page.get_by_label(seat).select_option("scripted:cook")
        hand.button("Change a").click()
        with gate.closed(hand):
            for part in ("how", "cook"):
                page.get_by_label("Replace parts", exact=True).select_option(part)
            name = page.get_by_label("Name of the group")
            name.press("Control+a")
            name.press_sequentially("al")
        name.press_sequentially("pha")  # the page has been drawn anew meanwhile
        name.press("Tab")
        hand.page.get_by_role("list", name="Parts of alpha").wait_for(state="attached")
    study = read(tmp_path)
    (ask,) = study["questions"]
    assert ask["items"][0]["options"] == ["four", "three"]
    assert [item["name"] for item in ask["items"]] == ["who", "text", "slider"]
    assert study["groups"][0]["name"] == "alpha"
    assert study["groups"][0]["parts"] == ["ask", "cook", "how"]
    assert study["groups"][0]["replace_parts"] == {"how": "", "cook": ""}
    assert [part["name"] for part in study["pages"]] == ["how", "how-3", "how-2"]
    (cook,) = study["blocks"]
    assert cook["fixed_keys"] == {"up": "down", "down": "up", "space": "interact"}
    assert cook["team"]["seats"] == ["scripted:cook", "scripted:cook"]


@pytest.mark.nightly
def test_two_quick_edits_of_cells_of_a_table_are_both_kept(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "words.csv").write_text("text,correct\nRED,red\nGREEN,green\n")
    with at_the_page(tmp_path) as (hand, address):
        page = hand.page
        gate = Gate(page)
        page.goto(f"{address}#/study/study.toml/media")
        hand.button("Edit the table").click()
        with gate.closed(hand):
            hand.type(page.get_by_label("text, row 1"), "BLUE")
            hand.type(page.get_by_label("correct, row 1"), "blue")
            hand.button("Remove row 2").click()
        page.get_by_role("status").filter(has_text="Cells saved").wait_for()
    assert (tmp_path / "words.csv").read_text() == "text,correct\nBLUE,blue\n"
