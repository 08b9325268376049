"""A plausible session to write, event by event."""

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine import events as ev
from minihuman.experiment.plan.session_plan import BlockText, EpisodePlan, KeyMap, Participant, SessionPlan
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
