"""Pages that lie lose and double nothing that was acknowledged, and what they claim of the time is noted."""

import pytest

from minihuman.experiment.machine.events import CLOCK_NOTE
from minihuman.web.session_host import SessionHost
from tests.counts import count
from tests.fault_simulation.nemesis import NEMESES, PageAhead, PageOfOldStreams
from tests.fault_simulation.simulation import Parts, simulate

pytestmark = pytest.mark.program


@pytest.mark.nightly(sample=True)
def test_no_page_that_lies_loses_or_doubles_what_was_acknowledged(monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[str] = []
    take_note = SessionHost.note

    def note(host: SessionHost, text: str) -> None:
        notes.extend([text] if text else [])
        take_note(host, text)

    monkeypatch.setattr(SessionHost, "note", note)
    failed = {}
    unnoted = []
    acknowledged = 0
    for seed in range(count(10, 2_000)):
        nemesis = NEMESES[seed % len(NEMESES)]
        notes.clear()
        outcome = simulate(seed, Parts(tab=nemesis))
        acknowledged += outcome.acknowledged
        # a page that gives two numberings one name is believed, and loses its own presses alone
        own = "lost: " if nemesis is PageOfOldStreams else "\0"
        if failures := [failure for failure in outcome.failures if not failure.startswith(own)]:
            failed[seed, nemesis.__name__] = failures
        is_noted = any(text.startswith(CLOCK_NOTE) for text in notes)
        if nemesis is PageAhead and not is_noted:
            unnoted.append(seed)
    print(f"\n{acknowledged} keys of lying pages acknowledged, {len(failed)} runs failed")
    assert failed == {}
    assert unnoted == []
    assert acknowledged > 0
