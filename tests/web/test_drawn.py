"""A group drawn after an answer, in a browser: nothing is safe before the draw, then everything is in the log."""

from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.status import count_participant_flow
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import Linked, SessionStarted, Stepped
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.recorder import DeferredRecorder, MemoryRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.web import messages
from minihuman.web.outbox import PageSettings
from minihuman.web.session_host import SessionHost
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.seats.test_drawn_group import TOML
from tests.web.browser import browsing
from tests.web.page_model import PageModel, Press
from tests.web.serving import serving

MS = 1_000_000
AGE = '[[questions.items]]\nname = "age"\nkind = "number"\nask = "How old are you?"\n'
GRID = "minihuman/MiniGrid-Empty-5x5-v0"
CORRIDOR = "tests.worlds.corridor:tests/Corridor-v0"
ACTIONS = '"back", "forward", "dive"', '"left", "right", "forward"'
STUDY = decode_protocol(TOML.replace(AGE, "").replace(CORRIDOR, GRID).replace(*ACTIONS).encode())


def presses(*keys: str, from_ms: int = 100) -> list[Press]:
    taps = ((from_ms + 100 * number, key) for number, key in enumerate(keys))
    return [(at * MS + up * 40 * MS, key, not up) for at, key in taps for up in (0, 1)]


def seat_of(data: Path) -> tuple[SessionHost, MemoryRecorder]:
    plan, kept = plan_next_session(STUDY, data), MemoryRecorder()
    session = build_session(plan, World, {"window": "web"}, picture_px=(84, 84))
    beside = make_agent_host(STUDY, plan, data)
    return SessionHost(session, DeferredRecorder(plan, lambda: kept), World, PageSettings((84, 84)), agent=beside), kept


def test_a_page_is_told_that_its_answers_are_safe_once_the_group_is_drawn(tmp_path: Path) -> None:
    seat, kept = seat_of(tmp_path)
    page = PageModel(seat, presses("enter", "2"), frame_ns=16 * MS)
    page.say(messages.RoundTripMessage(1, 2, 3, 4, 3))
    page.run()
    assert (kept.events, seat.safe()) == ([], 0)
    seat.restart()  # another page is there: the question is told it
    assert any(
        isinstance(told, messages.ScreenMessage) and told.screen["kind"] == "question"
        for _, told in seat.outgoing.after(0)
    )
    again = PageModel(seat, presses("enter", "enter", *"123123", from_ms=600), frame_ns=16 * MS)
    again.sent = page.sent
    again.run()
    seat.stop(Stop(seat.last_at_ns, "window_closed"))
    assert seat.safe() == again.sent[-1].n
    (started,) = [event for event in kept.events if isinstance(event, SessionStarted)]
    assert started.plan == expand_protocol(STUDY, enrol_participant(STUDY, 0, stratum="right"))
    assert kept.events[0] is started
    assert [event for event in kept.events if isinstance(event, Linked)]
    assert [event for event in kept.events if isinstance(event, Stepped)]
    assert find_violations(kept.events) == []
    assert list(compare_replay(kept.events, World)) == []


@pytest.mark.program
@needs("chromium")
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
        (held,) = read_enrolled(study)
        assert held.stratum == "right"
        for _ in range(2):
            somebody.to_play()
            for _ in range(5):
                somebody.press(*"1234")
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    (path,) = data.rglob("*.mcap")
    log = read_log(path)
    assert (log.plan.participant.stratum, log.plan.participant.group) == (held.stratum, held.group)
    assert log.end_reason == "complete"
    assert list(find_log_differences(path, World)) == []
    assert (count_participant_flow(study).came, count_participant_flow(study).before) == (2, {"did not agree": 1})
