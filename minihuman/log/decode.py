"""Messages back to events. The inverse of ``encode.truth``: an event written and read is equal."""

from collections.abc import Callable
from typing import Any, get_args

from minihuman.log import plan_messages as plans
from minihuman.log import topics
from minihuman.log.kinds import reader_of
from minihuman.log.observations import unpack
from minihuman.log.plain import readers
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.study import events as ev

_VERDICTS = get_args(ev.Verdict)
_OUTCOMES = get_args(ev.Outcome)
_END_REASONS = get_args(ev.EndReason)
_CAUSES = get_args(ev.EndCause)
_PAUSES = get_args(ev.PauseReason)


def decode(topic: str, data: bytes) -> ev.Event | None:
    """Read the event in a message; None for a topic that only repeats things for viewers.

    Raises:
        google.protobuf.message.DecodeError: if the bytes are no such message.
        LogError: if a word in it is outside its vocabulary.
    """
    read = _READERS.get(topic) or reader_of(topic)
    return None if read is None else read(data)


def _started(data: bytes) -> ev.SessionStarted:
    message = v1.SessionPlan.FromString(data)
    facts = {fact.name: fact.value for fact in message.facts}
    return ev.SessionStarted(message.t_ns, plans.read_session_plan(message), facts)


def _note(data: bytes) -> ev.Noted:
    message = v1.Note.FromString(data)
    return ev.Noted(message.t_ns, message.kind, message.text)


def _pause(data: bytes) -> ev.Paused | ev.Resumed:
    message = v1.Pause.FromString(data)
    if message.paused:
        return ev.Paused(message.t_ns, plans.one_of(_PAUSES, message.reason))
    return ev.Resumed(message.t_ns)


def _key_map(data: bytes) -> ev.KeyMapDrawn:
    message = v1.KeyMapDrawn.FromString(data)
    return ev.KeyMapDrawn(message.t_ns, message.episode, plans.read_key_map(message.key_map))


def _episode_start(data: bytes) -> ev.EpisodeStarted:
    message = v1.EpisodeStart.FromString(data)
    return ev.EpisodeStarted(
        t_ns=message.t_ns,
        plan=plans.read_episode_plan(message.plan),
        action_names=tuple(message.action_names),
        mission=message.mission,
        map=plans.read_map(message.map) if message.HasField("map") else None,
        pose=plans.read_pose(message.pose) if message.HasField("pose") else None,
        state_hash=message.state_hash,
        observation_hash=message.observation_hash,
    )


def _key(data: bytes) -> ev.KeyPressed:
    message = v1.KeyEvent.FromString(data)
    return ev.KeyPressed(
        t_ns=message.t_ns,
        key=message.key,
        symbol=message.symbol,
        down=message.down,
        action=message.action if message.HasField("action") else None,
        verdict=plans.one_of(_VERDICTS, message.verdict),
        phase=message.phase,
        waited_ns=message.waited_ns,
    )


def _step(data: bytes) -> ev.Stepped:
    message = v1.Step.FromString(data)
    return ev.Stepped(
        t_ns=message.t_ns,
        episode=message.episode,
        step=message.step,
        action=message.action,
        key=message.key,
        key_t_ns=message.key_t_ns,
        reward=message.reward,
        return_=message.episode_return,
        terminated=message.terminated,
        truncated=message.truncated,
        pose=plans.read_pose(message.pose) if message.HasField("pose") else None,
        rt_ms=message.rt_ms if message.HasField("rt_ms") else None,
        state_hash=message.state_hash,
        observation_hash=message.observation_hash,
    )


def _observation(data: bytes) -> ev.ObservationStored:
    message = v1.Observation.FromString(data)
    return ev.ObservationStored(message.t_ns, message.episode, message.step, unpack(message))


def _sample(data: bytes) -> ev.Sampled:
    message = v1.Sample.FromString(data)
    return ev.Sampled(message.t_ns, message.device, tuple(message.values), message.text)


def _frame(data: bytes) -> ev.FrameShown:
    message = v1.FrameShown.FromString(data)
    return ev.FrameShown(message.t_ns, message.episode, message.step, message.submit_ns, message.flip_ns)


def _episode_end(data: bytes) -> ev.EpisodeEnded:
    message = v1.EpisodeEnd.FromString(data)
    return ev.EpisodeEnded(
        t_ns=message.t_ns,
        episode=message.episode,
        outcome=plans.one_of(_OUTCOMES, message.outcome),
        steps=message.steps,
        return_=message.episode_return,
        state_hash=message.state_hash,
        cause=plans.one_of(_CAUSES, message.cause),
    )


def _session_end(data: bytes) -> ev.SessionEnded:
    message = v1.SessionEnd.FromString(data)
    return ev.SessionEnded(
        message.t_ns, plans.one_of(_END_REASONS, message.reason), message.detail, message.episodes_completed
    )


_READERS: dict[str, Callable[[bytes], Any]] = {
    topics.PLAN: _started,
    topics.NOTE: _note,
    topics.PAUSE: _pause,
    topics.KEY_MAP: _key_map,
    topics.EPISODE_START: _episode_start,
    topics.KEY: _key,
    topics.STEP: _step,
    topics.OBSERVATION: _observation,
    topics.FRAME: _frame,
    topics.SAMPLE: _sample,
    topics.EPISODE_END: _episode_end,
    topics.SESSION_END: _session_end,
    **readers(),
}
