"""No value of any option ends or hangs the process, ends in a traceback, or is approved and then cannot be played."""

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from tests.counts import count
from tests.worlds.option_cases import EDGES, PARAMETERS, Trials, edge_cases, one_world_a_kind, options_of

pytestmark = [pytest.mark.program, pytest.mark.nightly(sample=True)]
CASES = edge_cases()
STRIDE = count(131, 1)  # of which a plain run takes every so-manieth


def is_well(outcome: str) -> bool:
    return outcome.startswith("played") or (outcome.startswith("refused: study.toml:") and "$.blocks[0]" in outcome)


def test_every_option_at_every_edge_is_refused_in_a_line_or_plays():
    with Trials() as trials:
        chosen = CASES[::STRIDE]
        outcomes = [(case, trials.outcome(case)) for case in chosen]
    ill = [(case, outcome) for case, outcome in outcomes if not is_well(outcome)]
    played = sum(outcome.startswith("played") for _, outcome in outcomes)
    print(f"{len(outcomes)} cases: {played} played, {len(outcomes) - played - len(ill)} refused, {len(ill)} ill")
    assert ill == []


VALUES = st.one_of(
    st.sampled_from(EDGES),
    st.integers(-5, 70),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.integers(-2, 30), max_size=4),
    st.dictionaries(st.sampled_from(PARAMETERS), st.floats() | st.floats(0.01, 90.0), max_size=3),
)


@st.composite
def cases(draw):
    world = draw(st.sampled_from(one_world_a_kind()))
    return world, draw(st.dictionaries(st.sampled_from(options_of(world)), VALUES, min_size=1, max_size=4))


@pytest.fixture(scope="module")
def trials():
    with Trials() as trials:
        yield trials


@settings(
    max_examples=count(30, 3000),
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(case=cases())
def test_whatever_options_are_drawn_are_refused_in_a_line_or_play(trials, case):
    outcome = trials.outcome(case)
    assert is_well(outcome), outcome
