"""A group drawn after an answer, in a browser: nothing is safe before the draw, then everything is in the log."""

from pathlib import Path

import pytest

from minihuman.lab.flow import flow
from minihuman.lab.next_session import next_session
from minihuman.lab.prove import prove
from minihuman.lab.register_lines import read_register
from minihuman.log.read.open_log import open_log
from minihuman.log.record.held import HeldRecorder
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.seats.agent_seat import agent_seat
from minihuman.study.again import differences
from minihuman.study.events import Linked, SessionStarted, Stepped
from minihuman.study.expand import enrol, expand
from minihuman.study.inputs import Stop
from minihuman.study.protocol import decode
from minihuman.study.undrawn import session_of
from minihuman.study.well_formed import complaints
from minihuman.web import wire
from minihuman.web.seat import Seat
from minihuman.web.telling import Settings
from minihuman.worlds.adapt.world import World
from tests.seats.test_drawn_group import TOML
from tests.web.browser import browsing
from tests.web.page_model import PageModel, Press
from tests.web.serving import serving

MS = 1_000_000
AGE = '[[questions.items]]\nname = "age"\nkind = "number"\nask = "How old are you?"\n'
GRID = "minihuman/MiniGrid-Empty-5x5-v0"
CORRIDOR = "tests.worlds.corridor:tests/Corridor-v0"
ACTIONS = '"back", "forward", "dive"', '"left", "right", "forward"'
STUDY = decode(TOML.replace(AGE, "").replace(CORRIDOR, GRID).replace(*ACTIONS).encode())


def presses(*keys: str, from_ms: int = 100) -> list[Press]:
    taps = ((from_ms + 100 * number, key) for number, key in enumerate(keys))
    return [(at * MS + up * 40 * MS, key, not up) for at, key in taps for up in (0, 1)]


def seat_of(data: Path) -> tuple[Seat, MemoryRecorder]:
    plan, kept = next_session(STUDY, data), MemoryRecorder()
    session = session_of(plan, World, {"window": "web"}, picture_px=(84, 84))
    beside = agent_seat(STUDY, plan, data)
    return Seat(session, HeldRecorder(plan, lambda: kept), World, Settings((84, 84)), agent=beside), kept


def test_a_page_is_told_that_its_answers_are_safe_once_the_group_is_drawn(tmp_path: Path) -> None:
    seat, kept = seat_of(tmp_path)
    page = PageModel(seat, presses("enter", "2"), frame_ns=16 * MS)
    page.say(wire.Link(1, 2, 3, 4, 3))
    page.run()
    assert (kept.events, seat.safe()) == ([], 0)
    seat.begin_again()  # another page is there: the question is told it
    assert any(isinstance(told, wire.ToShow) and told.screen["kind"] == "question" for _, told in seat.saying.after(0))
    again = PageModel(seat, presses("enter", "enter", *"123123", from_ms=600), frame_ns=16 * MS)
    again.sent = page.sent
    again.run()
    seat.stop(Stop(seat.last_at_ns, "window_closed"))
    assert seat.safe() == again.sent[-1].n
    (started,) = [event for event in kept.events if isinstance(event, SessionStarted)]
    assert started.plan == expand(STUDY, enrol(STUDY, 0, stratum="right"))
    assert kept.events[0] is started
    assert [event for event in kept.events if isinstance(event, Linked)]
    assert [event for event in kept.events if isinstance(event, Stepped)]
    assert complaints(kept.events) == []
    assert list(differences(kept.events, World)) == []


@pytest.mark.program
def test_in_a_browser_nothing_is_on_the_disk_before_the_answer_that_draws_the_group(tmp_path: Path) -> None:
    protocol, data = tmp_path / "handed.toml", tmp_path / "data"
    protocol.write_bytes(STUDY.toml)
    study = data / "handed"
    with serving(protocol, data, links=2) as served, browsing() as sit_down:
        declines, somebody = (sit_down(f"http://127.0.0.1:{served.port}/#t={token}") for token in served.tokens)
        declines.until("s.welcomed && s.kind === 'page'")
        declines.page.locator('[data-target="decline"]').click()
        declines.until("s.finished")
        somebody.until("s.welcomed && s.kind === 'page'")
        somebody.press("enter")
        somebody.until("s.kind === 'question'")
        assert not any(data.rglob("*.mcap*"))
        somebody.press("2", "enter")
        somebody.to_play()
        assert len(list(data.rglob("*.mcap.part"))) == 1
        (held,) = read_register(study)
        assert held.stratum == "right"
        for _ in range(2):
            somebody.to_play()
            for _ in range(5):
                somebody.press(*"1234")
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    (path,) = data.rglob("*.mcap")
    log = open_log(path)
    assert (log.plan.participant.stratum, log.plan.participant.group) == (held.stratum, held.group)
    assert log.end_reason == "complete"
    assert list(prove(path, World)) == []
    assert (flow(study).came, flow(study).before) == (2, {"did not agree": 1})
