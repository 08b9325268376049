"""Any event, for Hypothesis."""

import math
from typing import get_args

import msgspec
import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from minihuman.activities.agent_blocks import events as agent_events
from minihuman.activities.correction import events as correction_events
from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import CriterionSpec, PlayPlan
from minihuman.activities.preferences import events as preference_events
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.questions.question import QuestionItemSpec
from minihuman.activities.rating.events import Rated
from minihuman.activities.team import events as team_events, message_events
from minihuman.activities.trials import events as trial_events
from minihuman.experiment.machine import events
from minihuman.experiment.plan.designs import GroupAssignment, PlayedEpisode
from minihuman.experiment.plan.session_plan import (
    BlockText,
    BonusSpec,
    EpisodePlan,
    KeyMap,
    Participant,
    PlannedPart,
    ResumeState,
    SessionPlan,
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
    st.builds(PlannedPart, st.just("page"), TEXTS, st.builds(PagePlan, TEXTS, st.lists(TEXTS, max_size=2).map(tuple))),
    st.builds(PlannedPart, st.just("keyboard_check"), TEXTS, st.builds(KeyboardCheckPlan, st.just(("1", "2")))),
    st.builds(PlannedPart, st.just("of-nobody-here"), TEXTS, st.dictionaries(TEXTS, TEXTS, max_size=2)),
    st.builds(
        PlannedPart,
        st.just("questions"),
        TEXTS,
        st.builds(QuestionsPlan, TEXTS, st.just((QuestionItemSpec("q", "choice", "?", ("a", "b"), right=2),)), COUNTS),
    ),
    st.builds(
        PlannedPart,
        st.just("play"),
        TEXTS,
        st.builds(PlayPlan, COUNTS, COUNTS, COUNTS, COUNTS, until=st.none() | st.just(CriterionSpec(3, 4))),
    ),
)
PLANS = st.builds(
    SessionPlan,
    study=st.just("study"),
    study_version=TEXTS,
    protocol_toml=st.binary(max_size=50),
    protocol_sha256=TEXTS,
    participant=st.builds(
        Participant,
        st.just("sub-01"),
        COUNTS,
        TEXTS,
        assigned=st.none() | st.just(GroupAssignment("thompson", 1, {"a": [1.5, 0.5], "b": [0, 0]})),
    ),
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
    standing=st.builds(
        ResumeState,
        COUNTS,
        FLOATS.filter(math.isfinite),
        st.just(("goal",)),
        st.just({"quiz": 1}),
        st.sampled_from([msgspec.UNSET, (PlayedEpisode({"size": 0.1}, 7, "goal", 1, 1.0),)]),
    ),
    bonus=st.none() | st.just(BonusSpec(0.1, "EUR", 2.0, 5.0)),
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
STARTS = st.builds(events.SessionStarted, TIMES, PLANS, st.dictionaries(TEXTS, TEXTS, max_size=3))
FLOATS_32 = st.lists(st.floats(width=32, allow_nan=False), max_size=4).map(tuple)
EVENTS_BY_TYPE: dict[type[events.Event], st.SearchStrategy[events.Event]] = {
    events.SessionStarted: STARTS,
    events.KeyMapDrawn: st.builds(events.KeyMapDrawn, TIMES, COUNTS, KEY_MAPS),
    events.EpisodeStarted: st.builds(
        events.EpisodeStarted,
        t_ns=TIMES,
        plan=EPISODE_PLANS,
        action_names=st.lists(TEXTS, max_size=3).map(tuple),
        mission=TEXTS,
        map=st.none() | MAPS,
        pose=st.none() | POSES,
        state_hash=SEEDS,
        observation_hash=SEEDS,
    ),
    events.KeyPressed: st.builds(
        events.KeyPressed,
        TIMES,
        TEXTS,
        TEXTS,
        st.booleans(),
        st.none() | COUNTS,
        st.sampled_from(get_args(events.KeyVerdict)),
        TEXTS,
    ),
    events.Stepped: st.builds(
        events.Stepped,
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
    events.ObservationStored: st.builds(events.ObservationStored, TIMES, COUNTS, COUNTS, OBSERVATIONS),
    events.FrameShown: st.builds(events.FrameShown, TIMES, COUNTS, COUNTS, TIMES, TIMES),
    events.EpisodeEnded: st.builds(
        events.EpisodeEnded,
        TIMES,
        COUNTS,
        st.sampled_from(get_args(events.Outcome)),
        COUNTS,
        FLOATS,
        SEEDS,
        st.sampled_from(get_args(events.EndCause)),
    ),
    events.EpisodesSkipped: st.builds(
        events.EpisodesSkipped, TIMES, COUNTS, COUNTS, st.sampled_from(get_args(events.SkipReason))
    ),
    events.Scored: st.builds(events.Scored, TIMES, COUNTS, FLOATS, FLOATS),
    events.ClauseDone: st.builds(events.ClauseDone, TIMES, COUNTS, COUNTS, COUNTS, TEXTS),
    events.PartStarted: st.builds(events.PartStarted, TIMES, COUNTS, TEXTS, TEXTS),
    events.PartEnded: st.builds(events.PartEnded, TIMES, COUNTS, st.sampled_from(get_args(events.PartEnd)), COUNTS),
    events.PageShown: st.builds(events.PageShown, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES),
    events.TextTyped: st.builds(events.TextTyped, TIMES, TEXTS),
    events.TextChanged: st.builds(
        events.TextChanged, TIMES, COUNTS, TEXTS, TEXTS, st.lists(TEXTS, max_size=3).map(tuple), COUNTS, COUNTS
    ),
    events.PointerUsed: st.builds(
        events.PointerUsed, TIMES, st.sampled_from(["pressed", "moved", "released"]), FLOATS, FLOATS, TEXTS, FLOATS
    ),
    events.AxisMoved: st.builds(events.AxisMoved, TIMES, TEXTS, FLOATS),
    events.AnswerChanged: st.builds(events.AnswerChanged, TIMES, COUNTS, TEXTS, TEXTS),
    events.Answered: st.builds(
        events.Answered,
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
    events.Paused: st.builds(events.Paused, TIMES, st.sampled_from(get_args(events.PauseReason))),
    events.Resumed: st.builds(events.Resumed, TIMES),
    events.Noted: st.builds(events.Noted, TIMES, TEXTS, TEXTS),
    events.Sampled: st.builds(events.Sampled, TIMES, TEXTS, st.lists(FLOATS, max_size=3).map(tuple), TEXTS),
    events.DesignDecided: st.builds(
        events.DesignDecided,
        TIMES,
        COUNTS,
        COUNTS,
        TEXTS,
        COUNTS,
        st.dictionaries(TEXTS, COUNTS | TEXTS, max_size=2),
        st.none() | SEEDS,
        st.booleans(),
        st.dictionaries(TEXTS, FLOATS.filter(math.isfinite), max_size=2),
        SEEDS,
    ),
    events.Linked: st.builds(events.Linked, TIMES, TIMES, TIMES, TIMES, TIMES, st.none() | FLOATS),
    agent_events.PolicyGiven: st.builds(agent_events.PolicyGiven, TIMES, COUNTS, COUNTS, TEXTS, TEXTS),
    agent_events.LearnerAsked: st.builds(agent_events.LearnerAsked, TIMES, COUNTS, COUNTS),
    agent_events.Advised: st.builds(agent_events.Advised, TIMES, COUNTS, COUNTS, COUNTS, FLOATS_32),
    agent_events.ControlChanged: st.builds(
        agent_events.ControlChanged,
        TIMES,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(agent_events.Controller)),
        st.sampled_from(get_args(agent_events.ControlReason)),
        TIMES,
    ),
    trial_events.TrialResolved: st.builds(trial_events.TrialResolved, TIMES, COUNTS, COUNTS, TEXTS, TIMES),
    trial_events.SoundPlayed: st.builds(
        trial_events.SoundPlayed, TIMES, COUNTS, COUNTS, TEXTS, COUNTS, TIMES, TIMES, TIMES, FLOATS
    ),
    trial_events.StimuliShown: st.builds(
        trial_events.StimuliShown, TIMES, COUNTS, COUNTS, COUNTS, st.lists(TEXTS).map(tuple), TIMES, TIMES, TIMES
    ),
    trial_events.ResponseTaken: st.builds(
        trial_events.ResponseTaken, TIMES, COUNTS, COUNTS, COUNTS, TEXTS, COUNTS, TIMES, TIMES
    ),
    Rated: st.builds(Rated, TIMES, COUNTS, COUNTS, st.sampled_from((1.0, -1.0)), TIMES),
    preference_events.StretchShown: st.builds(
        preference_events.StretchShown,
        TIMES,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(preference_events.Side)),
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
    preference_events.PairSeen: st.builds(preference_events.PairSeen, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES),
    preference_events.NothingToCompare: st.builds(preference_events.NothingToCompare, TIMES, COUNTS, COUNTS),
    preference_events.Preferred: st.builds(
        preference_events.Preferred,
        TIMES,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(preference_events.PairAnswer)),
        TIMES,
        COUNTS,
        TIMES,
    ),
    correction_events.EpisodeLookedAt: st.builds(
        correction_events.EpisodeLookedAt,
        TIMES,
        *[COUNTS] * 4,
        TEXTS,
        TEXTS,
        SEEDS,
        st.lists(COUNTS, max_size=4).map(tuple),
        SEEDS,
    ),
    team_events.TeamFormed: st.builds(
        team_events.TeamFormed,
        TIMES,
        COUNTS,
        TEXTS,
        COUNTS,
        COUNTS,
        TEXTS,
        st.lists(TEXTS, max_size=3).map(tuple),
        TEXTS,
    ),
    team_events.SeatsReadied: st.builds(
        team_events.SeatsReadied, TIMES, COUNTS, st.lists(FLOATS, max_size=8).map(tuple)
    ),
    team_events.JointStepped: st.builds(
        team_events.JointStepped,
        TIMES,
        COUNTS,
        COUNTS,
        st.lists(COUNTS, max_size=3).map(tuple),
        st.lists(FLOATS, max_size=3).map(tuple),
        st.lists(TEXTS, max_size=3).map(tuple),
        SEEDS,
        st.lists(FLOATS, max_size=8).map(tuple),
    ),
    team_events.InputLate: st.builds(team_events.InputLate, TIMES, COUNTS, COUNTS, COUNTS, TEXTS, TIMES),
    team_events.PictureCorrected: st.builds(team_events.PictureCorrected, TIMES, COUNTS, COUNTS, TIMES, TIMES),
    team_events.SeatSeen: st.builds(
        team_events.SeatSeen, TIMES, COUNTS, COUNTS, COUNTS, st.sampled_from(get_args(team_events.SeatState)), COUNTS
    ),
    team_events.SeatTaken: st.builds(
        team_events.SeatTaken, TIMES, COUNTS, COUNTS, COUNTS, st.sampled_from(get_args(team_events.SeatHolder))
    ),
    message_events.MessageTyped: st.builds(message_events.MessageTyped, TIMES, TEXTS),
    message_events.MessageEdited: st.builds(
        message_events.MessageEdited, TIMES, TEXTS, st.lists(TEXTS, max_size=3).map(tuple), COUNTS, COUNTS
    ),
    message_events.MessageShown: st.builds(
        message_events.MessageShown,
        *(TIMES, COUNTS, COUNTS, COUNTS, TEXTS),
        st.lists(FLOATS, max_size=2).map(tuple),
        TEXTS,
    ),
    team_events.TeamEnded: st.builds(
        team_events.TeamEnded, TIMES, COUNTS, st.sampled_from(get_args(team_events.GoneReason))
    ),
    correction_events.NothingToCorrect: st.builds(correction_events.NothingToCorrect, TIMES, COUNTS, COUNTS),
    correction_events.CorrectionSeen: st.builds(
        correction_events.CorrectionSeen, TIMES, COUNTS, COUNTS, COUNTS, TIMES, TIMES
    ),
    correction_events.CorrectionBegun: st.builds(correction_events.CorrectionBegun, TIMES, *[COUNTS] * 5, SEEDS, TIMES),
    correction_events.CorrectionStepped: st.builds(
        correction_events.CorrectionStepped,
        TIMES,
        *[COUNTS] * 5,
        TEXTS,
        TIMES,
        FLOATS,
        st.booleans(),
        st.booleans(),
        SEEDS,
    ),
    correction_events.CorrectionEnded: st.builds(
        correction_events.CorrectionEnded,
        TIMES,
        COUNTS,
        COUNTS,
        COUNTS,
        st.sampled_from(get_args(correction_events.CorrectionOutcome)),
    ),
    events.SessionEnded: st.builds(
        events.SessionEnded, TIMES, st.sampled_from(get_args(events.EndReason)), TEXTS, COUNTS
    ),
}
EVENTS = st.one_of(*EVENTS_BY_TYPE.values())
