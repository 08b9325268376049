"""Sessions to write: a plausible one, event by event, and hypothesis strategies for every event there is."""

import math
from typing import get_args

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from minihuman.study import events as ev
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
FLOOR = Map(
    unit="cell",
    bounds=(-0.5, -0.5, 8.5, 8.5),
    walls=((-0.5, -0.5, 8.5, -0.5), (8.5, -0.5, 8.5, 8.5), (4.5, -0.5, 4.5, 3.5)),
    things=(Thing("green goal", 7, 7, 0.5, "#1b9e77"),),
)


def session_plan(
    *, episodes: int = 3, session: int = 1, segment: int = 1, participant: str = "sub-07", record: bool = False
) -> SessionPlan:
    key_map = KeyMap(keys={"3": "left", "1": "right", "7": "forward"}, spare_keys=("2", "9"), spare="ignore", seed=77)
    return SessionPlan(
        study="fourrooms",
        study_version="2",
        protocol_toml=b'study = "fourrooms"\n',
        protocol_sha256="ab" * 32,
        participant=Participant(participant, 6, "transfer"),
        session=session,
        study_seed=2**63 + 5,
        allocation_sha256=None,
        overridden=True,
        consent_text="Do you agree?",
        consent_sha256="cd" * 32,
        key_pool=("1", "2", "3", "7", "9"),
        keyboard_check=True,
        texts=(BlockText("Find the green square.", "{outcome}", "Rest a little.", 10.0),),
        closing_text="Thank you.",
        episodes=tuple(
            EpisodePlan(
                episode=number,
                block=0,
                block_name="grid",
                episode_in_block=number,
                episodes_in_block=episodes,
                world="minihuman/MiniGrid-FourRooms-v0",
                options={"max_steps": 100},
                seed=1000 + number,
                actions=("left", "right", "forward"),
                key_map=key_map,
                show_keys=False,
                pace="on_key",
                step_period_ms=0.0,
                noop=None,
                auto_repeat=False,
                max_steps=100,
                view="partial",
                palette="classic",
                record_observations=record,
            )
            for number in range(episodes)
        ),
        first_episode=0,
        segment=segment,
    )


def session_events(plan: SessionPlan, *, steps: int = 20) -> list[ev.Event]:
    """A whole session as a person would produce it: consent, key maps, steps, a pause, an end."""
    t_ns = 0
    events: list[ev.Event] = [
        ev.SessionStarted(t_ns, plan, {"player": "human", "python": "3.11"}),
        ev.Noted(5, "consent", "agreed"),
    ]
    for episode in plan.episodes[plan.first_episode :]:
        t_ns += 1_000_000_000
        events.append(ev.KeyMapDrawn(t_ns, episode.episode, episode.key_map))
        events.append(
            ev.EpisodeStarted(
                t_ns, episode, ("left", "right", "forward"), "get to the goal", FLOOR, Pose(1, 0, 1, 0.0), 11, 12
            )
        )
        if episode.record_observations:
            events.append(ev.ObservationStored(t_ns, episode.episode, 0, _picture(0)))
        for step in range(1, steps + 1):
            t_ns += 300_000_000
            events.append(ev.KeyPressed(t_ns, "7", "è", True, 2, "accepted", "playing"))
            if episode.record_observations:
                events.append(ev.ObservationStored(t_ns, episode.episode, step, _picture(step)))
            events.append(_step(t_ns, episode.episode, step, last=step == steps))
            events.append(ev.FrameShown(t_ns + 9_000_000, episode.episode, step, t_ns + 1_000_000, t_ns + 9_000_000))
            events.append(ev.KeyPressed(t_ns + 80_000_000, "7", "è", False, None, "release", "playing"))
        t_ns += 100_000_000
        events.append(ev.EpisodeEnded(t_ns, episode.episode, "goal", steps, 0.9, 2**64 - steps))
        events += [ev.Paused(t_ns + 1, "participant"), ev.Resumed(t_ns + 2)]
    events.append(ev.SessionEnded(t_ns + 3, "complete", "", len(plan.episodes)))
    return events


def _picture(step: int) -> NDArray[np.uint8]:
    return np.full((6, 8, 3), step, np.uint8)


def _step(t_ns: int, episode: int, step: int, *, last: bool) -> ev.Stepped:
    return ev.Stepped(
        t_ns=t_ns + 50_000,
        episode=episode,
        step=step,
        action=2,
        key="7",
        key_t_ns=t_ns,
        reward=0.9 if last else 0.0,
        return_=0.9 if last else 0.0,
        terminated=last,
        truncated=False,
        pose=Pose(1 + step / 10, 0, 1, 0.0),
        rt_ms=290.5,
        state_hash=2**64 - step,
        observation_hash=step,
    )


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
    ev.SessionEnded: st.builds(ev.SessionEnded, TIMES, st.sampled_from(get_args(ev.EndReason)), TEXTS, COUNTS),
}
EVENTS = st.one_of(*EVENTS_BY_TYPE.values())
