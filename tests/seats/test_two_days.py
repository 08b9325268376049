"""The study over two days in one file: simulated, it balances and verifies; played in a window, nothing is lost."""

from collections import Counter
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.status import format_status
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Answered, EpisodesSkipped, Scored
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.seats.answering_typist import Participant
from tests.seats.station import started
from tests.xserver import Typist, xvfb

PROTOCOL = Path(__file__).parents[2] / "protocols" / "two-days.toml"
SIZE_PX = (1024, 768)


@pytest.mark.program
@pytest.mark.nightly(sample=True)
def test_simulated_participants_do_both_days_and_balance(tmp_path: Path) -> None:
    study, many = read_protocol(PROTOCOL), count(4, 1000)
    logs = [read_log(path) for path in simulate(study, tmp_path, participants=many, seed=1, player="optimal")]
    people = {log.plan.participant.id: log.plan.participant.group for log in logs}
    slots = build_allocation_list(study)[:many]
    assert Counter(people.values()) == Counter(slot.group for slot in slots)
    for log in logs if many < 10 else logs[:: many // 20]:
        assert verify_episodes(log).difference == ""
    for log in logs:
        if log.end_reason == "screened_out":
            assert [event.right for event in log.part_events if isinstance(event, Answered)].count(False)
            continue
        assert log.end_reason == "complete"
        assert all(len(episode.frames) == len(episode.actions) + 1 for episode in log.episodes)
        scored = [event for event in log.part_events if isinstance(event, Scored)]
        assert len(scored) == 16
        assert scored[-1].total == pytest.approx(sum(event.points for event in scored))
        skipped = [event for event in log.part_events if isinstance(event, EpisodesSkipped)]
        assert [event.reason for event in skipped] == (["criterion"] if log.plan.session == 1 else [])
    second = [log for log in logs if log.plan.session == 2]
    done = [log for log in logs if log.plan.session == 1 and log.end_reason == "complete"]
    assert {log.plan.participant.id for log in second} == {log.plan.participant.id for log in done}
    assert sum("complete" in line for line in format_status(tmp_path / "two-days")) == len(second) + len(done)


@pytest.mark.program
@pytest.mark.nightly
@needs("xvfb")
def test_both_days_are_played_through_a_window(tmp_path: Path) -> None:
    study = read_protocol(PROTOCOL)
    with xvfb(SIZE_PX) as display:
        for session in (1, 2):
            plan = expand_protocol(study, enrol_participant(study, 1), session=session)
            day = (
                "--session",
                str(session),
                "--any-day",
                "--participant",
                "sub-02",
                "--windowed",
                "--window",
                "pygame",
            )
            station = started("run", PROTOCOL, "--data", tmp_path, *day, display=display)
            typist = Typist(display)
            typist.focus(TITLE)
            name = f"sub-02_ses-{session:02d}.mcap"
            folder = tmp_path / "two-days/sub-02" / f"ses-{session:02d}"
            somebody = Participant(typist, plan, folder / f"{name}.part", SIZE_PX)
            somebody.take_part()
            _, complained = station.communicate(timeout=PATIENCE_S)
            typist.close()
            assert station.returncode == 0, complained
            log = read_log(folder / name)
            answered = [event for event in log.part_events if isinstance(event, Answered)]
            assert [(event.part_name, event.item, event.value) for event in answered] == somebody.given
            assert (log.end_reason, verify_episodes(log).difference) == ("complete", "")
            assert all(len(episode.frames) == len(episode.actions) + 1 for episode in log.episodes)
