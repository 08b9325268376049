"""A session that was quit in a pause, gone on with, killed, and gone on with again: one clock, true playing times."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from minihuman.dataset.measures import playing_s
from minihuman.experiment.machine.events import Event, Noted, Paused, Resumed, SessionEnded, SessionStarted
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.builders import STARTED_NS, episode, events_of, session_of
from tests.log.samples import session_plan

SECOND = 1_000_000_000
GAPS_S = (0, 600, 5)  # the wall clock from one segment's start to the next's; the last was set back


def resumed(data: Path) -> tuple[SessionLog, list[float]]:
    """Three segments of one session: quit in a pause, killed in an episode, then played to the end; and true times."""
    episodes = [episode(number, start_ns=2 * SECOND) for number in range(3)]
    plan = session_of(episodes).plan
    wall_ns, path = STARTED_NS, None
    for segment, played in enumerate(episodes, 1):
        its_plan = msgspec.structs.replace(plan, segment=segment, first_episode=segment - 1)
        facts = {"player": "human", "started_monotonic_ns": str(10 * segment), "monotonic_clock": "test clock"}
        wall_ns += GAPS_S[segment - 1] * SECOND
        middle = int(played.t_ns[len(played.t_ns) // 2]) + 1
        events: list[Event] = [
            event for event in events_of(session_of([played])) if not isinstance(event, SessionEnded)
        ]
        events[0] = SessionStarted(0, its_plan, facts)
        events += [Paused(middle, "participant"), Resumed(middle + SECOND // 50)]
        events.sort(key=lambda event: event.t_ns)
        last_ns = events[-1].t_ns
        if segment == 1:  # Escape, then yes: nobody resumes
            events += [Paused(last_ns + 1, "quit_question"), SessionEnded(last_ns + SECOND, "quit", "", 1)]
        elif segment == 3:
            events += [Noted(last_ns + 1, "consent", "still given"), SessionEnded(last_ns + SECOND, "complete", "", 3)]
        recorder = McapRecorder(data, its_plan, started_ns=wall_ns, settings=RecorderSettings(sync=lambda fd: None))
        recorder.write(events)
        path = recorder.close()
    assert path is not None
    return read_log(path), [(int(one.t_ns[-1] - one.t_ns[0]) - SECOND // 50) / 1e9 for one in episodes]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[SessionLog, list[float]]:
    return resumed(tmp_path_factory.mktemp("resumed"))


def test_playing_time_is_wall_time_less_the_pauses_in_every_segment(made: tuple[SessionLog, list[float]]) -> None:
    log, true_s = made
    assert [playing_s(one) for one in log.episodes] == pytest.approx(true_s, abs=1 / 60)


def test_session_time_strictly_grows_over_all_segments(made: tuple[SessionLog, list[float]]) -> None:
    log, _ = made
    assert (np.diff(np.concatenate([one.t_ns for one in log.episodes])) > 0).all()
    assert (np.diff(log.keys.column("t_ns")) >= 0).all()
    assert [note.t_ns for note in log.notes] == sorted(note.t_ns for note in log.notes)
    assert log.segments[1].start_ns == 600 * SECOND
    assert log.segments[2].start_ns == log.segments[1].end_ns + 1  # a wall clock that was set back turns nothing back


def test_a_pause_ends_with_its_segment(made: tuple[SessionLog, list[float]]) -> None:
    first = made[0].segments[0]
    assert [end for _, end in first.pauses][-1] == first.end_ns
    assert all(begin >= made[0].segments[1].start_ns for begin, _ in made[0].segments[1].pauses)


def test_each_segment_says_how_it_ended_and_where_the_machines_clock_stood(
    made: tuple[SessionLog, list[float]],
) -> None:
    log, _ = made
    assert [(one.number, one.end_reason) for one in log.segments] == [(1, "quit"), (2, "cut_off"), (3, "complete")]
    assert [one.started_monotonic_ns for one in log.segments] == [10, 20, 30]
    assert {one.monotonic_clock for one in log.segments} == {"test clock"}
    assert [(one.number, one.attempt, one.segment) for one in log.episodes] == [(1, 1, 1), (2, 1, 2), (3, 1, 3)]


def test_a_log_that_does_not_say_where_the_monotonic_clock_stood_still_reads(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, session_plan(), started_ns=STARTED_NS)
    recorder.write([SessionStarted(0, session_plan(), {"player": "human"})])
    recorder.drain()
    (segment,) = read_log(recorder.segment_path.part).segments
    assert (segment.started_monotonic_ns, segment.monotonic_clock) == (None, "")
    recorder.close()
