"""What is written comes back equal: every event type, any order, finished or still live."""

import tempfile
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from minihuman.experiment.machine import events as ev
from minihuman.experiment.machine.activity import find_kind, list_built_in_kinds
from minihuman.log import topics
from minihuman.log.codec import decode_event, encode_event, load_activity_rows
from minihuman.log.preview import PreviewEncoder
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan
from tests.log.strategies import EVENTS, EVENTS_BY_TYPE, STARTS


def of_kinds() -> set[type[ev.Event]]:
    """The events that kinds of activity add."""
    return {row.event for kind in list_built_in_kinds() for row in load_activity_rows(find_kind(kind))}


def test_every_kind_of_event_has_a_strategy() -> None:
    assert set(EVENTS_BY_TYPE) == {*get_args(ev.Event), *of_kinds(), ev.DesignDecided} - {ev.ActivityEvent}


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("kind", EVENTS_BY_TYPE, ids=lambda kind: kind.__name__)
def test_an_event_becomes_one_message_and_comes_back_equal(kind: type[ev.Event]) -> None:
    @settings(max_examples=count(10, 500), deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(EVENTS_BY_TYPE[kind])
    def comes_back(event: ev.Event) -> None:
        topic, message = encode_event(event)
        assert decode_event(topic, message.SerializeToString(deterministic=True)) == event

    comes_back()


@pytest.mark.nightly(sample=True)
@settings(max_examples=count(8, 300), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(start=STARTS, rest=st.lists(EVENTS.filter(lambda event: not isinstance(event, ev.SessionStarted)), max_size=6))
def test_any_events_written_are_read_in_the_same_order(start: ev.SessionStarted, rest: list[ev.Event]) -> None:
    events = [start, *rest]
    with tempfile.TemporaryDirectory() as folder:
        recorder = McapRecorder(
            Path(folder), start.plan, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda _fd: None)
        )
        for event in events:
            recorder.write([event])
        recorder.drain()
        assert list(read_events(recorder.segment_path.part)) == events
        log = recorder.close()
        assert log is not None
        assert list(read_events(log)) == events


def test_what_viewers_get_is_no_event_of_its_own() -> None:
    previews = PreviewEncoder(STARTED_NS)
    for event in session_events(session_plan(episodes=1)):
        topic, message = encode_event(event)
        for drawn_on, drawn in previews.encode(topic, message.SerializeToString()):
            assert decode_event(drawn_on, drawn.SerializeToString()) is None


def test_viewers_get_an_episodes_poses_at_its_end_or_where_the_segment_is_cut_off() -> None:
    events = session_events(session_plan(episodes=2))
    ends = [place for place, event in enumerate(events) if isinstance(event, ev.EpisodeEnded)]
    previews, found = PreviewEncoder(STARTED_NS), []
    for place, event in enumerate(events[: ends[1]]):  # the second episode is cut off
        topic, message = encode_event(event)
        drawn = [one for name, one in previews.encode(topic, message.SerializeToString()) if name == topics.POSE]
        assert bool(drawn) == (place == ends[0])
        found += drawn
    found += [one for _, one in previews.finish()]
    told = [
        [one.pose for one in part if isinstance(one, ev.EpisodeStarted | ev.Stepped)]
        for part in (events[: ends[0]], events[ends[0] : ends[1]])
    ]
    assert [[(one.position.x, one.position.z) for one in path.poses] for path in found] == [
        [(pose.x, pose.z) for pose in poses if pose is not None] for poses in told
    ]
    assert list(previews.finish()) == []
