"""Any event, for Hypothesis."""

import math
from typing import get_args

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from minihuman.study import events as ev
from minihuman.study.activities import agent_events as agent
from minihuman.study.activities import correction_events as corrections
from minihuman.study.activities import pair_events as pairs
from minihuman.study.activities.drafts import Question
from minihuman.study.activities.keyboard import KeyboardPlan
from minihuman.study.activities.pages import PagePlan
from minihuman.study.activities.play_plan import Criterion, PlayPlan
from minihuman.study.activities.questions import QuestionsPlan
from minihuman.study.plan import (
    BlockText,
    Bonus,
    EpisodePlan,
    KeyMap,
    Part,
    Participant,
    SessionPlan,
    Standing,
)
from minihuman.worlds.pose import Map, Pose, Thing

STARTED_NS = 1_790_000_000_000_000_000

TIMES = st.integers(0, 2**60)
COUNTS = st.integers(0, 2**40)
SEEDS = st.integers(0, 2**64 - 1)
TEXTS = st.text(max_size=20)
FLOATS = st.floats(allow_nan=False)
LENGTHS = st.floats(-1e6, 1e6)
POSES = st.builds(Pose, LENGTHS, LENGTHS, LENGTHS, st.floats(-7, 7))
COLOURS = st.from_regex(r"#[0-9a-f]{6}", fullmatch=True)
BOXES = st.tuples(LENGTHS, LENGTHS, LENGTHS, LENGTHS).map(
    lambda box: (min(box[0], box[2]), min(box[1], box[3]), max(box[0], box[2]), max(box[1], box[3]))
)
MAPS = st.builds(
    Map,
    unit=st.sampled_from(["cell", "m"]),
    bounds=BOXES,
    walls=st.lists(st.tuples(LENGTHS, LENGTHS, LENGTHS, LENGTHS), max_size=3).map(tuple),
    things=st.lists(st.builds(Thing, TEXTS, LENGTHS, LENGTHS, st.floats(0, 1e6), COLOURS), max_size=2).map(tuple),
)
KEY_MAPS = st.builds(
    KeyMap,
    keys=st.dictionaries(TEXTS, TEXTS, max_size=4),
    spare_keys=st.lists(TEXTS, max_size=3).map(tuple),
    spare=st.sampled_from(["ignore", "distractor"]),
    seed=SEEDS,
)
OPTIONS = st.dictionaries(TEXTS, st.none() | st.booleans() | st.integers(-(2**53), 2**53) | TEXTS, max_size=3)
EPISODE_PLANS = st.builds(
    EpisodePlan,
    episode=COUNTS,
    block=COUNTS,
    block_name=TEXTS,
    episode_in_block=COUNTS,
    episodes_in_block=COUNTS,
    world=TEXTS,
    options=OPTIONS,
    seed=SEEDS,
    actions=st.lists(TEXTS, max_size=3).map(tuple),
    key_map=KEY_MAPS,
    show_keys=st.booleans(),
    pace=st.sampled_from(["on_key", "real_time"]),
    step_period_ms=FLOATS,
    noop=st.none() | TEXTS,
    auto_repeat=st.booleans(),
    max_steps=COUNTS,
    view=st.sampled_from(["partial", "full"]),
    palette=st.sampled_from(["classic", "colour-safe"]),
    record_observations=st.booleans(),
)
PARTS = st.one_of(
    st.builds(Part, st.just("page"), TEXTS, st.builds(PagePlan, TEXTS, st.lists(TEXTS, max_size=2).map(tuple))),
    st.builds(Part, st.just("keyboard_check"), TEXTS, st.builds(KeyboardPlan, st.just(("1", "2")))),
    st.builds(Part, st.just("of-nobody-here"), TEXTS, st.dictionaries(TEXTS, TEXTS, max_size=2)),
    st.builds(
        Part,
        st.just("questions"),
        TEXTS,
        st.builds(QuestionsPlan, TEXTS, st.just((Question("q", "choice", "?", ("a", "b"), right=2),)), COUNTS),
    ),
    st.builds(
        Part,
        st.just("play"),
        TEXTS,
        st.builds(PlayPlan, COUNTS, COUNTS, COUNTS, COUNTS, until=st.none() | st.just(Criterion(3, 4))),
    ),
)
PLANS = st.builds(
    SessionPlan,
    study=st.just("study"),
    study_version=TEXTS,
    protocol_toml=st.binary(max_size=50),
    protocol_sha256=TEXTS,
    participant=st.builds(Participant, st.just("sub-01"), COUNTS, TEXTS),
    session=st.integers(1, 99),
    study_seed=SEEDS,
    allocation_sha256=st.none() | TEXTS,
    overridden=st.booleans(),
    consent_text=TEXTS,
    consent_sha256=TEXTS,
    key_pool=st.lists(TEXTS, max_size=3).map(tuple),
    keyboard_check=st.booleans(),
    texts=st.lists(st.builds(BlockText, TEXTS, TEXTS, TEXTS, FLOATS), max_size=2).map(tuple),
    closing_text=TEXTS,
    episodes=st.lists(EPISODE_PLANS, max_size=2).map(tuple),
    first_episode=COUNTS,
    segment=st.just(1),
    parts=st.lists(PARTS, max_size=3).map(tuple),
    words=st.dictionaries(TEXTS, TEXTS, max_size=2),
    language=st.sampled_from(["en", "zh"]),
    standing=st.builds(Standing, COUNTS, FLOATS.filter(math.isfinite), st.just(("goal",)), st.just({"quiz": 1})),
    bonus=st.none() | st.just(Bonus(0.1, "EUR", 2.0, 5.0)),
    fonts=st.just(()) | st.just(("NotoSerif-Regular.ttf",)),
)
ARRAYS = npst.arrays(
    st.sampled_from(["<i2", ">i8", "u1", "<u4", "<f4", ">f8", "?"]).map(np.dtype),
    npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    elements={"allow_nan": False},
)
PICTURES = npst.arrays(np.uint8, st.tuples(st.integers(1, 6), st.integers(1, 6), st.just(3)))
SCALARS = ARRAYS.filter(lambda array: array.ndim == 0).map(lambda array: array[()])
OBSERVATIONS = st.recursive(
    PICTURES | ARRAYS | TEXTS | st.integers(-(2**63), 2**64 - 1) | st.booleans() | FLOATS | st.none() | SCALARS,
    lambda inner: st.dictionaries(TEXTS, inner, max_size=3) | st.lists(inner, max_size=3).map(tuple),
    max_leaves=4,
)
STARTS = st.builds(ev.SessionStarted, TIMES, PLANS, st.dictionaries(TEXTS, TEXTS, max_size=3))
FLOATS_32 = st.lists(st.floats(width=32, allow_nan=False), max_size=4).map(tuple)
EVENTS_BY_TYPE: dict[type[ev.Event], st.SearchStrategy[ev.Event]] = {
    ev.SessionStarted: STARTS,
    ev.KeyMapDrawn: st.builds(ev.KeyMapDrawn, TIMES, COUNTS, KEY_MAPS),
    ev.EpisodeStarted: st.builds(
        ev.EpisodeStarted,
        t_ns=TIMES,
        plan=EPISODE_PLANS,
        action_names=st.lists(TEXTS, max_size=3).map(tuple),
        mission=TEXTS,
        map=st.none() | MAPS,
        pose=st.none() | POSES,
        state_hash=SEEDS,
        observation_hash=SEEDS,
    ),
    ev.KeyPressed: st.builds(
        ev.KeyPressed,
        TIMES,
        TEXTS,
        TEXTS,
        st.booleans(),
        st.none() | COUNTS,
        st.sampled_from(get_args(ev.Verdict)),
        TEXTS,
    ),
    ev.Stepped: st.builds(
        ev.Stepped,
        t_ns=TIMES,
        episode=COUNTS,
        step=COUNTS,
        action=COUNTS,
        key=TEXTS,
        key_t_ns=TIMES,
        reward=FLOATS,
        return_=FLOATS,
        terminated=st.booleans(),
        truncated=st.booleans(),
        pose=st.none() | POSES,
        rt_ms=st.none() | FLOATS,
        state_hash=SEEDS,
        observation_hash=SEEDS,
    ),
    ev.ObservationStored: st.builds(ev.ObservationStored, TIMES, COUNTS, COUNTS, OBSERVATIONS),
    ev.FrameShown: st.builds(ev.FrameShown, TIMES, COUNTS, COUNTS, TIMES, TIMES),
    ev.EpisodeEnded: st.builds(
        ev.EpisodeEnded,
        TIMES,
        COUNTS,
        st.sampled_from(get_args(ev.Outcome)),
        COUNTS,
        FLOATS,
        SEEDS,
        st.sampled_from(get_args(ev.EndCause)),
    ),
    ev.EpisodesSkipped: st.builds(ev.EpisodesSkipped, TIMES, COUNTS, COUNTS, st.sampled_from(get_args(ev.SkipReason))),
    ev.Scored: st.builds(ev.Scored, TIMES, COUNTS, FLOATS, FLOATS),
    ev.ClauseDone: st.builds(ev.ClauseDone, TIMES, COUNTS, COUNTS, COUNTS, TEXTS),
    ev.PartStarted: st.builds(ev.PartStarted, TIMES, COUNTS, TEXTS, TEXTS),
    ev.PartEnded: st.builds(ev.PartEnded, TIMES, COUNTS, st.sampled_from(get_args(ev.PartEnd)), COUNTS),
    ev.PageShown: st.builds(ev.PageShown, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES),
    ev.TextTyped: st.builds(ev.TextTyped, TIMES, TEXTS),
    ev.PointerUsed: st.builds(
        ev.PointerUsed, TIMES, st.sampled_from(["pressed", "moved", "released"]), FLOATS, FLOATS, TEXTS, FLOATS
    ),
    ev.AnswerChanged: st.builds(ev.AnswerChanged, TIMES, COUNTS, TEXTS, TEXTS),
    ev.Answered: st.builds(
        ev.Answered,
        TIMES,
        COUNTS,
        TEXTS,
        TEXTS,
        TEXTS,
        COUNTS,
        TEXTS,
        TEXTS,
        TIMES,
        TIMES,
        COUNTS,
        st.none() | st.booleans(),
    ),
    ev.Paused: st.builds(ev.Paused, TIMES, st.sampled_from(get_args(ev.PauseReason))),
    ev.Resumed: st.builds(ev.Resumed, TIMES),
    ev.Noted: st.builds(ev.Noted, TIMES, TEXTS, TEXTS),
    ev.Sampled: st.builds(ev.Sampled, TIMES, TEXTS, st.lists(FLOATS, max_size=3).map(tuple), TEXTS),
    ev.Linked: st.builds(ev.Linked, TIMES, TIMES, TIMES, TIMES, TIMES, st.none() | FLOATS),
    agent.PolicyGiven: st.builds(agent.PolicyGiven, TIMES, COUNTS, COUNTS, TEXTS, TEXTS),
    agent.LearnerAsked: st.builds(agent.LearnerAsked, TIMES, COUNTS, COUNTS),
    agent.Advised: st.builds(agent.Advised, TIMES, COUNTS, COUNTS, COUNTS, FLOATS_32),
    agent.ControlChanged: st.builds(
        agent.ControlChanged,
        TIMES,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(agent.Who)),
        st.sampled_from(get_args(agent.ControlReason)),
        TIMES,
    ),
    agent.Rated: st.builds(agent.Rated, TIMES, COUNTS, COUNTS, st.sampled_from((1.0, -1.0)), TIMES),
    pairs.StretchShown: st.builds(
        pairs.StretchShown,
        TIMES,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(pairs.Side)),
        COUNTS,
        COUNTS,
        COUNTS,
        TEXTS,
        TEXTS,
        SEEDS,
        st.lists(COUNTS, max_size=4).map(tuple),
        SEEDS,
        SEEDS,
    ),
    pairs.PairSeen: st.builds(pairs.PairSeen, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES),
    pairs.NothingToCompare: st.builds(pairs.NothingToCompare, TIMES, COUNTS, COUNTS),
    pairs.Preferred: st.builds(
        pairs.Preferred, TIMES, COUNTS, COUNTS, st.sampled_from(get_args(pairs.Verdict)), TIMES, COUNTS, TIMES
    ),
    corrections.EpisodeLookedAt: st.builds(
        corrections.EpisodeLookedAt,
        TIMES,
        *[COUNTS] * 4,
        TEXTS,
        TEXTS,
        SEEDS,
        st.lists(COUNTS, max_size=4).map(tuple),
        SEEDS,
    ),
    corrections.NothingToCorrect: st.builds(corrections.NothingToCorrect, TIMES, COUNTS, COUNTS),
    corrections.CorrectionSeen: st.builds(corrections.CorrectionSeen, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES),
    corrections.CorrectionBegun: st.builds(corrections.CorrectionBegun, TIMES, *[COUNTS] * 5, SEEDS, TIMES),
    corrections.CorrectionStepped: st.builds(
        corrections.CorrectionStepped,
        TIMES,
        *[COUNTS] * 5,
        TEXTS,
        TIMES,
        FLOATS,
        st.booleans(),
        st.booleans(),
        SEEDS,
    ),
    corrections.CorrectionEnded: st.builds(
        corrections.CorrectionEnded,
        TIMES,
        COUNTS,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(corrections.CorrectionOutcome)),
    ),
    ev.SessionEnded: st.builds(ev.SessionEnded, TIMES, st.sampled_from(get_args(ev.EndReason)), TEXTS, COUNTS),
}
EVENTS = st.one_of(*EVENTS_BY_TYPE.values())
