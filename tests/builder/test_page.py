"""The builder's page in a browser: what it shows, how it follows the file, and that it can be used without a mouse."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from tests.builder.hand import Hand, at_the_page, open_desk
from tests.builder.test_data import TOML as ROOMS
from tests.counts import count
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.test_accessible import serious

pytestmark = [needs("chromium"), pytest.mark.program]
PROTOCOLS = Path(__file__).parents[2] / "protocols"
PART = "#/study/online.toml/parts/practice"
VIEWS = (
    "",
    "#/study/online.toml",
    PART,
    *(f"#/study/online.toml/{view}" for view in ("texts", "media", "settings", "file", "data")),
)
TABLET_PX = (800, 1100)


def expect(subject: Any) -> Any:
    """Return what Playwright expects of a part of a page, imported when a test asks."""
    return pytest.importorskip("playwright.sync_api").expect(subject)


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder with a protocol."""
    shutil.copy(PROTOCOLS / "online.toml", tmp_path)
    return tmp_path


def show(hand: Hand, address: str) -> None:
    """Show a view anew, and wait until nothing loads any more."""
    hand.page.goto("about:blank")
    hand.page.goto(address)
    hand.page.locator("main h1, main h2, main textarea, main label.drop").first.wait_for()


def instructions(hand: Hand) -> Any:
    return hand.page.get_by_label("Instructions", exact=True)


@pytest.mark.nightly(sample=True)
def test_no_view_has_a_serious_finding_or_is_wider_than_a_tablet(lab: Path) -> None:
    found: dict[str, list[str]] = {}
    (lab / "rooms.toml").write_text(ROOMS)
    list(simulate(decode_protocol(ROOMS.encode()), lab / "sessions", participants=1, seed=1, player="random"))
    too_wide = []
    with at_the_page(lab, size=TABLET_PX) as (hand, address):
        for colours in count(("dark",), ("light", "dark")):
            hand.page.emulate_media(color_scheme=colours)
            for view in count(VIEWS[::3], VIEWS):
                show(hand, address + view)
                if view == PART:
                    instructions(hand).wait_for()
                    hand.button("Further settings", exact=False).click()
                found[f"{colours} {view}"] = serious(hand.page)
                if hand.page.evaluate("document.documentElement.scrollWidth > innerWidth"):
                    too_wide.append(view)
        show(hand, address + "#/study/rooms.toml/data")
        hand.button("Details of sub-01, session 1").click()
        hand.button("How episodes ended, by block").click()
        hand.page.get_by_role("group", name="Result of the query").wait_for()
        found["data"] = serious(hand.page)
        show(hand, address + PART)
        hand.button("Add a part to map-first").click()
        hand.page.locator("dialog .kind-play").click()
        hand.page.get_by_label("Search worlds").wait_for()
        found["picker"] = serious(hand.page)
    assert {view: findings for view, findings in found.items() if findings} == {}
    assert too_wide == []


def test_the_preview_follows_each_change_and_a_trial_leaves_no_data(lab: Path) -> None:
    with at_the_page(lab) as (hand, address):
        show(hand, address + PART)
        hand.wait_for_preview("This is a map.")
        hand.type(instructions(hand), "Go to the other room.")
        hand.wait_for_preview("Go to the other room.")
        hand.type(hand.page.get_by_label("Episodes *"), "0")
        hand.page.get_by_text("The preview waits until the mistakes are put right.").wait_for()
        assert "an episode count is 1 to" in hand.page.locator(".field.wrong .mistakes").first.inner_text()
        hand.button("Undo").click()
        hand.wait_for_preview("Go to the other room.")
        with hand.page.context.expect_page() as opened:
            hand.page.get_by_role("link", name="Try this part").click()
        trial = opened.value
        assert "not data" in trial.get_by_role("banner").inner_text()
        trial.frame_locator("iframe").get_by_text("Go to the other room.").wait_for()
        trial.close()
    assert list((lab / "sessions").rglob("*.mcap*")) == []


def test_the_page_follows_a_file_that_is_edited_beside_it_and_says_conflicts(lab: Path) -> None:
    file = lab / "online.toml"
    with open_desk(lab) as address, browsing(size=(1440, 900)) as sit_down:
        hand, other = (Hand(sit_down(address + PART).page) for _ in range(2))
        for tab in (hand, other):
            instructions(tab).wait_for()
        hand.type(instructions(hand), "In the first tab.")
        expect(instructions(other)).to_have_value("In the first tab.")
        other.page.get_by_text("The file was edited elsewhere").wait_for()

        hand.page.route("**/api/study?*", lambda route: route.abort())  # it does not look meanwhile
        file.write_text(file.read_text().replace("participants = 60", "participants = 61  # two more weeks"))
        hand.type(instructions(hand), "After the other editor.")
        alert = hand.page.get_by_role("alert").filter(has_text="Not saved: blocks")
        alert.wait_for()
        assert "After the other editor." not in file.read_text()
        hand.button("Make this change again").click()
        alert.wait_for(state="detached")
        hand.wait_until_saved()
    text = file.read_text()
    assert "After the other editor." in text
    assert "participants = 61  # two more weeks" in text


def test_parts_are_ordered_and_left_by_keyboard_alone(lab: Path) -> None:
    with at_the_page(lab) as (hand, address):
        show(hand, address)
        keyboard = hand.page.keyboard
        hand.button("Open Does a map help? FourRooms at home").focus()
        keyboard.press("Enter")
        chip = hand.page.get_by_role("list", name="Parts of map-first").get_by_role("button", name="World practice")
        chip.wait_for()
        chip.focus()
        keyboard.press("Enter")
        hand.button("Move practice later in map-first").focus()
        keyboard.press("Enter")
        hand.wait_until_saved()
        names = hand.page.get_by_role("list", name="Parts of map-first").locator(".part")
        expect(names.nth(2)).to_have_text("test")
        expect(names.nth(3)).to_have_text("practice")
        hand.button("Add a part to map-first", exact=False).focus()
        keyboard.press("Enter")
        hand.page.locator("dialog").wait_for()
        keyboard.press("Escape")
        hand.page.locator("dialog").wait_for(state="detached")


def test_a_desk_that_has_ended_loses_nothing_that_was_typed(lab: Path) -> None:
    before = (lab / "online.toml").read_text()
    with browsing(size=(1440, 900)) as sit_down:
        with open_desk(lab) as address:
            hand = Hand(sit_down(address + PART).page)
            instructions(hand).wait_for()
        hand.type(instructions(hand), "Nobody hears this.")
        alert = hand.page.get_by_role("alert").filter(has_text="The desk does not answer")
        alert.get_by_text("Nobody hears this.").wait_for()  # from where it can be copied
        assert hand.button("Make this change again").is_enabled()
    assert (lab / "online.toml").read_text() == before


def test_the_desk_leads_to_the_builder_and_back(lab: Path) -> None:
    with at_the_page(lab) as (hand, address):
        hand.page.goto(address.removesuffix("builder/"))
        hand.page.get_by_role("link", name="online").click()
        hand.page.get_by_role("link", name="Change it in the builder").click()
        hand.page.get_by_role("link", name="Run it").click()
        hand.page.get_by_role("heading", name="Next participant").wait_for()


@pytest.mark.nightly
def test_an_address_that_changes_while_the_page_is_first_drawn_is_followed(lab: Path) -> None:
    with at_the_page(lab) as (hand, address):
        hand.page.add_init_script(
            """new MutationObserver((_, observer) => {
                if (!document.querySelector("main")) return;
                observer.disconnect();
                location.hash = "#/study/online.toml/settings";
            }).observe(document, { childList: true, subtree: true });"""
        )
        hand.page.goto("about:blank")
        hand.page.goto(address)
        hand.page.get_by_role("navigation", name="Settings of the study").wait_for(timeout=20_000)
