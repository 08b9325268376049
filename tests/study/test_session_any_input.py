import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.inputs import FocusChanged, Input, KeyDown, KeyUp, ScreenShown, Stop, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.study.sessions import MS, corridor_plan

pytestmark = pytest.mark.nightly(sample=True)

PLANS = [
    corridor_plan(),
    corridor_plan(consent="May we?", instruction="Walk.", feedback="{outcome}", closing="Bye.", check=True),
    corridor_plan(blocks=2, episodes=1, rest="Rest.", break_s=0.3, more='key_map = "shown"\nauto_repeat = true'),
    corridor_plan(more='pace = "real_time"\nstep_period_ms = 50\nnoop_action = "stay"'),
    corridor_plan(more='pace = "real_time"\nstep_period_ms = 50'),
    corridor_plan(first_episode=1, segment=2, consent="May we?"),
]
KEYS = ("1", "2", "3", "4", "5", "6", "enter", "enter", "enter", "escape", "f8", "f9", "f12", "q")

times = st.integers(0, 200).map(lambda ms: ms * MS)
keys = st.sampled_from(KEYS)
inputs: st.SearchStrategy[Input] = st.one_of(
    st.builds(KeyDown, times, keys, keys, st.booleans()),
    st.builds(KeyDown, times, keys, keys),
    st.builds(KeyUp, times, keys, keys),
    st.builds(Tick, times),
    st.builds(lambda t_ns: ScreenShown(t_ns, t_ns, t_ns), times),
    st.builds(FocusChanged, times, st.booleans()),
)
stops = st.builds(Stop, times, st.sampled_from(["window_closed", "signal", "disk_full", "internal_error"]))


def told(plan, happened: list[Input]):
    """All that a session says; times given are spans since the input before."""
    session = SessionMachine(plan, World, {})
    events, now_ns = [], 0
    for one in happened:
        now_ns += one.t_ns
        if isinstance(one, ScreenShown):
            one = ScreenShown(now_ns, now_ns, now_ns)
        events += session.receive(_at(one, now_ns))
    return events, session


def _at(one: Input, t_ns: int) -> Input:
    match one:
        case KeyDown(key=key, symbol=symbol, repeat=repeat):
            return KeyDown(t_ns, key, symbol, repeat)
        case KeyUp(key=key, symbol=symbol):
            return KeyUp(t_ns, key, symbol)
        case FocusChanged(focused=focused):
            return FocusChanged(t_ns, focused)
        case Stop(reason=reason):
            return Stop(t_ns, reason)
        case Tick():
            return Tick(t_ns)
    return one


@settings(max_examples=count(150, 5_000), deadline=None)
@given(st.sampled_from(PLANS), st.lists(inputs, max_size=80), st.none() | stops)
def test_any_inputs_give_a_well_formed_log_and_the_same_one_again(plan, happened, stop):
    happened = [*happened, *([stop] if stop else [])]
    events, session = told(plan, happened)
    assert find_violations(events) == []
    assert session.over or not stop
    assert told(plan, happened)[0] == events


@settings(max_examples=count(50, 2_000), deadline=None)
@given(st.sampled_from(PLANS), st.lists(inputs, max_size=60))
def test_every_key_down_and_up_before_the_end_is_logged_once(plan, happened):
    session = SessionMachine(plan, World, {})
    for one in happened:
        was_over = session.over
        logged = [event for event in session.receive(one) if type(event).__name__ == "KeyPressed"]
        is_key = isinstance(one, KeyDown | KeyUp)
        if was_over or not is_key:
            assert logged == []
        elif not (session.over and not logged):  # a due tick may have ended the session before the key was looked at
            [event] = logged
            assert (event.key, event.down) == (one.key, isinstance(one, KeyDown))
