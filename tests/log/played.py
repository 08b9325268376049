"""A session really played: the session machine, a scripted window, a grid world. For tests that replay or kill it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from minihuman.experiment.machine.events import Event, FrameShown, KeyMapDrawn, KeyPressed, SessionEnded, SessionStarted
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.worlds.adapters.world import World
from tests.log.samples import STARTED_NS

KEYS = ("3", "1", "7")


def played_events(plan: SessionPlan, *, steps: int, seed: int = 0) -> list[Event]:
    """Random keys in real worlds: every episode is abandoned after so many steps, unless it ends before."""
    rng = np.random.default_rng(seed)
    world = World(plan.episodes[0].world, plan.episodes[0].options)
    events: list[Event] = [SessionStarted(0, plan, {"player": "random"})]
    t_ns = 0
    for episode in plan.episodes[plan.first_episode :]:
        play = RunningEpisode(episode, world, picture_px=None)
        t_ns += 1_000_000_000
        events += [
            KeyMapDrawn(t_ns, episode.episode, episode.key_map),
            play.start(t_ns),
            *play.stored_observations(t_ns),
        ]
        while play.outcome is None and play.steps < steps:
            t_ns += 250_000_000
            key = KEYS[rng.integers(len(KEYS))]
            action = play.action_of(key)
            assert action is not None
            events.append(KeyPressed(t_ns, key, key, True, action, "accepted", "playing"))
            stepped = play.step(t_ns, action, key=key, key_t_ns=t_ns)
            events += [*play.stored_observations(t_ns), stepped]
            events.append(
                FrameShown(t_ns + 16_000_000, episode.episode, play.steps, t_ns + 1_000_000, t_ns + 16_000_000)
            )
        events.append(play.end(t_ns + 20_000_000))
    events.append(SessionEnded(t_ns + 30_000_000, "complete", "", len(plan.episodes)))
    world.close()
    return events


def record(data: Path, plan: SessionPlan, events: Sequence[Event], *, started_ns: int = STARTED_NS) -> Path:
    """Write a whole session and finish it."""
    recorder = McapRecorder(data, plan, started_ns=started_ns)
    for event in events:
        recorder.write([event])
    log = recorder.close()
    assert log is not None
    return log
