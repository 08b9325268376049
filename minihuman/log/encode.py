"""Events as messages.

``truth`` is undone by ``decode``; ``for_viewers`` only repeats it in the well-known types that rerun and Foxglove draw.
"""

import math
from collections.abc import Iterator

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from minihuman.log import kinds, topics
from minihuman.log import plan_messages as plans
from minihuman.log.decode import decode
from minihuman.log.floor_plan import floor_plan_png
from minihuman.log.observations import pack
from minihuman.log.plain import message_of
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.study import events as ev
from minihuman.worlds.pose import Pose

FRAME_ID = "world"  # x right, y up, z down the page, as minihuman.worlds.pose says


def truth(event: ev.Event) -> tuple[str, Message]:
    """Name the topic of an event and put all of it into one message."""
    if isinstance(event, ev.KindEvent):
        return kinds.message_of(event)
    plain = message_of(event)
    if plain is not None:
        return plain
    match event:
        case ev.SessionStarted():
            return topics.PLAN, plans.session_plan_message(event.plan, t_ns=event.t_ns, facts=event.facts)
        case ev.KeyMapDrawn():
            key_map = plans.key_map_message(event.key_map)
            return topics.KEY_MAP, v1.KeyMapDrawn(t_ns=event.t_ns, episode=event.episode, key_map=key_map)
        case ev.EpisodeStarted():
            return topics.EPISODE_START, _episode_start(event)
        case ev.KeyPressed():
            return topics.KEY, v1.KeyEvent(
                t_ns=event.t_ns,
                key=event.key,
                symbol=event.symbol,
                down=event.down,
                action=event.action,
                verdict=event.verdict,
                phase=event.phase,
                waited_ns=event.waited_ns,
            )
        case ev.Stepped():
            return topics.STEP, _step(event)
        case ev.ObservationStored():
            return topics.OBSERVATION, v1.Observation(
                t_ns=event.t_ns, episode=event.episode, step=event.step, **pack(event.observation)
            )
        case ev.FrameShown():
            return topics.FRAME, v1.FrameShown(
                t_ns=event.t_ns,
                episode=event.episode,
                step=event.step,
                submit_ns=event.submit_ns,
                flip_ns=event.flip_ns,
            )
        case ev.EpisodeEnded():
            return topics.EPISODE_END, v1.EpisodeEnd(
                t_ns=event.t_ns,
                episode=event.episode,
                outcome=event.outcome,
                steps=event.steps,
                episode_return=event.return_,
                state_hash=event.state_hash,
                cause=event.cause,
            )
        case ev.Paused():
            return topics.PAUSE, v1.Pause(t_ns=event.t_ns, paused=True, reason=event.reason)
        case ev.Resumed():
            return topics.PAUSE, v1.Pause(t_ns=event.t_ns, paused=False)
        case ev.Noted():
            return topics.NOTE, v1.Note(t_ns=event.t_ns, kind=event.kind, text=event.text)
        case ev.Sampled():
            return topics.SAMPLE, v1.Sample(t_ns=event.t_ns, device=event.device, values=event.values, text=event.text)
        case ev.SessionEnded():
            return topics.SESSION_END, v1.SessionEnd(
                t_ns=event.t_ns,
                reason=event.reason,
                detail=event.detail,
                episodes_completed=event.episodes_completed,
            )
    raise AssertionError(f"{type(event).__name__} has no message; give it a row in log/plain.py")


def for_viewers(topic: str, data: bytes, *, started_ns: int) -> Iterator[tuple[str, Message]]:
    """Yield what viewers draw of a message that holds the truth: a pose, a floor plan, a picture, a readable line.

    ``started_ns`` is the wall clock at the segment's time 0.

    Raises:
        Exception: whatever protobuf or a reader of ours says of bytes that are no such message.
    """
    match topic:
        case topics.KEY | topics.FRAME:
            return
        case topics.STEP:  # there are thousands
            step = v1.Step.FromString(data)
            if step.HasField("pose"):
                yield topics.POSE, _pose_in_frame(plans.read_pose(step.pose), _timestamp(started_ns + step.t_ns))
        case topics.OBSERVATION:
            seen = v1.Observation.FromString(data)
            if seen.WhichOneof("observation") == "png":
                stamp = _timestamp(started_ns + seen.t_ns)
                image = CompressedImage(timestamp=stamp, frame_id=FRAME_ID, data=seen.png, format="png")
                yield topics.OBSERVATION_IMAGE, image
        case _:
            if (event := decode(topic, data)) is not None:
                yield from _of_event(event, _timestamp(started_ns + event.t_ns))


def _of_event(event: ev.Event, stamp: Timestamp) -> Iterator[tuple[str, Message]]:
    if isinstance(event, ev.EpisodeStarted):
        if event.pose is not None:
            yield topics.POSE, _pose_in_frame(event.pose, stamp)
        if event.map is not None:
            image = floor_plan_png(event.map, event.pose)
            yield topics.MAP_IMAGE, CompressedImage(timestamp=stamp, frame_id=FRAME_ID, data=image, format="png")
    line = _line(event)
    if line is not None:
        level, name, text = line
        yield topics.LOG, Log(timestamp=stamp, level=level, name=name, message=text)


def _pose_in_frame(pose: Pose, stamp: Timestamp) -> PoseInFrame:
    return PoseInFrame(timestamp=stamp, frame_id=FRAME_ID, pose=_foxglove_pose(pose))


def caused_ns(event: ev.Event) -> int:
    """When what caused an event arrived: a press, a step's key, the hand-over of a frame; else the event's own time."""
    match event:
        case ev.Stepped():
            return event.key_t_ns
        case ev.KeyPressed():
            return event.t_ns - event.waited_ns
        case ev.FrameShown():
            return event.submit_ns
        case _:
            return event.t_ns


def _episode_start(event: ev.EpisodeStarted) -> v1.EpisodeStart:
    return v1.EpisodeStart(
        t_ns=event.t_ns,
        plan=plans.episode_plan_message(event.plan),
        action_names=event.action_names,
        mission=event.mission,
        map=None if event.map is None else plans.map_message(event.map),
        pose=None if event.pose is None else plans.pose_message(event.pose),
        state_hash=event.state_hash,
        observation_hash=event.observation_hash,
    )


def _step(event: ev.Stepped) -> v1.Step:
    return v1.Step(
        t_ns=event.t_ns,
        episode=event.episode,
        step=event.step,
        action=event.action,
        key=event.key,
        key_t_ns=event.key_t_ns,
        reward=event.reward,
        episode_return=event.return_,
        terminated=event.terminated,
        truncated=event.truncated,
        pose=None if event.pose is None else plans.pose_message(event.pose),
        rt_ms=event.rt_ms,
        state_hash=event.state_hash,
        observation_hash=event.observation_hash,
    )


def _line(event: ev.Event) -> tuple[Log.Level.ValueType, str, str] | None:
    match event:
        case ev.SessionStarted():
            who = event.plan.participant
            text = f"{event.plan.study}: {who.id}, group {who.group}, session {event.plan.session}"
            return Log.INFO, "session", f"{text}, segment {event.plan.segment}"
        case ev.EpisodeStarted():
            return (
                Log.INFO,
                "episode",
                f"episode {event.plan.episode + 1} starts: {event.plan.world}, {event.mission!r}",
            )
        case ev.EpisodeEnded():
            text = f"episode {event.episode + 1} ends: {event.outcome} after {event.steps} steps"
            return Log.INFO, "episode", f"{text}, return {event.return_:.3f}"
        case ev.KeyMapDrawn():
            keys = ", ".join(f"{key}={action}" for key, action in event.key_map.keys.items())
            return Log.INFO, "keys", f"from episode {event.episode + 1}: {keys}"
        case ev.PartStarted():
            return Log.INFO, "part", f"part {event.part + 1}: {event.name} ({event.kind})"
        case ev.Answered():
            return Log.INFO, "answer", f"{event.part_name}, {event.item}: {event.value}"
        case ev.Paused():
            return Log.WARNING, "pause", f"paused: {event.reason}"
        case ev.Resumed():
            return Log.INFO, "pause", "resumed"
        case ev.Noted():
            return (Log.ERROR if "error" in event.kind else Log.INFO), event.kind, event.text
        case ev.SessionEnded():
            level = Log.INFO if event.reason == "complete" else Log.WARNING
            text = f"session ends: {event.reason} after {event.episodes_completed} episodes"
            return level, "session", f"{text}: {event.detail}" if event.detail else text
        case _:
            return None


def _timestamp(unix_ns: int) -> Timestamp:
    return Timestamp(seconds=unix_ns // 1_000_000_000, nanos=unix_ns % 1_000_000_000)


def _foxglove_pose(pose: Pose) -> FoxglovePose:
    half = pose.yaw_rad / 2
    return FoxglovePose(
        position=Vector3(x=pose.x, y=pose.y, z=pose.z),
        orientation=Quaternion(x=0.0, y=math.sin(half), z=0.0, w=math.cos(half)),
    )
