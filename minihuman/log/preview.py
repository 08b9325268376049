"""Previews of a log's record for viewers: rerun and Foxglove draw poses, floor plans, images and readable lines."""

import io
import math
from collections.abc import Callable, Iterator

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from PIL import Image, ImageDraw

from minihuman.experiment.machine import events
from minihuman.log import topics
from minihuman.log.codec import POSE, decode_event
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.worlds.pose import Map, Pose

FRAME_ID = "world"  # x right, y up, z down the page, as minihuman.worlds.pose says


def encode_png(picture: Image.Image) -> bytes:
    """Return a picture as a PNG."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    return buffer.getvalue()


class PreviewEncoder:
    """Encodes previews of a segment's record: an episode's poses, floor plans, pictures and readable lines.

    Args:
        started_ns: the wall clock at the segment's time 0, in nanoseconds since 1970.
        encode_picture: encodes the picture of a floor plan; as PNG by default.
    """

    def __init__(self, started_ns: int, encode_picture: Callable[[Image.Image], bytes] = encode_png) -> None:
        self.is_pose_per_step = False  # whether each pose has its own message before its step, as in earlier releases
        self._started_ns = started_ns
        self._encode_picture = encode_picture
        self._path: PosesInFrame | None = None  # of the running episode

    def encode(self, topic: str, data: bytes, event: events.Event | None = None) -> Iterator[tuple[str, Message]]:
        """Yield the topic and the message of each preview that comes before a message of the record, in order.

        Args:
            topic: the topic of the message of the record.
            data: the bytes of that message.
            event: the event in it, if it has been decoded already.

        Raises:
            Exception: any error that protobuf or one of our decoders raises for bytes that are not such a message.
        """
        match topic:
            case topics.KEY | topics.FRAME:
                return
            case topics.STEP:  # there are thousands
                step = v1.Step.FromString(data)
                if step.HasField("pose"):
                    yield from self._add_pose(POSE.decode(step.pose), step.t_ns)
            case topics.OBSERVATION:
                observation = v1.Observation.FromString(data)
                if observation.WhichOneof("observation") == "png":
                    stamp = self._timestamp(observation.t_ns)
                    image = CompressedImage(timestamp=stamp, frame_id=FRAME_ID, data=observation.png, format="png")
                    yield topics.OBSERVATION_IMAGE, image
            case _:
                event = event or decode_event(topic, data)
                if event is not None:
                    yield from self._encode_event(event)

    def add_step(self, event: events.Stepped) -> None:
        """Add a step to the running episode's poses; nothing comes before its message."""
        assert not self.is_pose_per_step
        if event.pose is not None:
            self._path = self._path or self._begin_path(event.t_ns)
            self._path.poses.append(_convert_pose(event.pose))

    def finish(self) -> Iterator[tuple[str, Message]]:
        """Yield the message with the poses of the running episode, if it has any, and begin a new one."""
        path = self._path
        self._path = None
        if path is not None:
            yield topics.POSE, path

    def _encode_event(self, event: events.Event) -> Iterator[tuple[str, Message]]:
        """Yield the previews of an event that is not a step, an observation, a key or a frame."""
        stamp = self._timestamp(event.t_ns)
        if isinstance(event, events.EpisodeStarted | events.EpisodeEnded | events.SessionEnded):
            yield from self.finish()
        if isinstance(event, events.EpisodeStarted):
            if event.pose is not None:
                yield from self._add_pose(event.pose, event.t_ns)
            if event.map is not None:
                image = self._encode_picture(draw_floor_plan(event.map, event.pose))
                yield topics.MAP_IMAGE, CompressedImage(timestamp=stamp, frame_id=FRAME_ID, data=image, format="png")
        line = _describe_event(event)
        if line is not None:
            level, name, text = line
            yield topics.LOG, Log(timestamp=stamp, level=level, name=name, message=text)

    def _add_pose(self, pose: Pose, t_ns: int) -> Iterator[tuple[str, Message]]:
        """Add a pose to those of the running episode; yield it at once if each pose has its own message.

        Args:
            pose: the pose.
            t_ns: the time of the pose in nanoseconds since the segment began.
        """
        converted = _convert_pose(pose)
        if self.is_pose_per_step:
            yield topics.POSE, PoseInFrame(timestamp=self._timestamp(t_ns), frame_id=FRAME_ID, pose=converted)
            return
        self._path = self._path or self._begin_path(t_ns)
        self._path.poses.append(converted)

    def _begin_path(self, t_ns: int) -> PosesInFrame:
        return PosesInFrame(timestamp=self._timestamp(t_ns), frame_id=FRAME_ID)

    def _timestamp(self, t_ns: int) -> Timestamp:
        seconds, nanos = divmod(self._started_ns + t_ns, 1_000_000_000)
        return Timestamp(seconds=seconds, nanos=nanos)


def _convert_pose(pose: Pose) -> FoxglovePose:
    """Return a pose in the form that viewers require: a position and a quaternion."""
    half_rad = pose.yaw_rad / 2
    orientation = Quaternion(x=0.0, y=math.sin(half_rad), z=0.0, w=math.cos(half_rad))
    return FoxglovePose(position=Vector3(x=pose.x, y=pose.y, z=pose.z), orientation=orientation)


_LogLine = tuple[Log.Level.ValueType, str, str]  # level, name and text


def _describe_event(event: events.Event) -> _LogLine | None:
    """Describe an event in a line for viewers; return None for an event that needs none."""
    match event:
        case events.SessionStarted() | events.SessionEnded():
            return _describe_session(event)
        case events.EpisodeStarted() | events.EpisodeEnded() | events.KeyMapDrawn():
            return _describe_episode(event)
        case events.PartStarted():
            return Log.INFO, "part", f"part {event.part + 1}: {event.name} ({event.kind})"
        case events.Answered():
            return Log.INFO, "answer", f"{event.part_name}, {event.item}: {event.value}"
        case events.Paused():
            return Log.WARNING, "pause", f"paused: {event.reason}"
        case events.Resumed():
            return Log.INFO, "pause", "resumed"
        case events.Noted():
            level = Log.ERROR if "error" in event.kind else Log.INFO
            return level, event.kind, event.text
    return None


def _describe_session(event: events.SessionStarted | events.SessionEnded) -> _LogLine:
    if isinstance(event, events.SessionEnded):
        level = Log.INFO if event.reason == "complete" else Log.WARNING
        text = f"session ends: {event.reason} after {event.episodes_completed} episodes"
        if event.detail:
            text = f"{text}: {event.detail}"
        return level, "session", text
    plan = event.plan
    participant = plan.participant
    text = f"{plan.study}: {participant.id}, group {participant.group}, session {plan.session}"
    return Log.INFO, "session", f"{text}, segment {plan.segment}"


def _describe_episode(event: events.EpisodeStarted | events.EpisodeEnded | events.KeyMapDrawn) -> _LogLine:
    match event:
        case events.EpisodeStarted():
            text = f"episode {event.plan.episode + 1} starts: {event.plan.world}, {event.mission!r}"
            return Log.INFO, "episode", text
        case events.EpisodeEnded():
            text = f"episode {event.episode + 1} ends: {event.outcome} after {event.steps} steps"
            return Log.INFO, "episode", f"{text}, return {event.return_:.3f}"
        case events.KeyMapDrawn():
            keys = ", ".join(f"{key}={action}" for key, action in event.key_map.keys.items())
            return Log.INFO, "keys", f"from episode {event.episode + 1}: {keys}"


LONG_SIDE_PX = 384
MARGIN_PX = 12
ARROW_PX = 9  # the least radius of the agent's arrow
_ARROW_RADIUS = 0.4  # of the agent's arrow, in cells or metres
_ARROW_BACK_RAD = 2.5  # angle from the arrow's tip to its two other corners
_MIN_EXTENT = 1e-9  # against a division by zero for a map without extent
PAPER = "#ffffff"
FLOOR = "#f1efe9"
WALL = "#33363b"
AGENT = "#0072b2"


def draw_floor_plan(world_map: Map, pose: Pose | None) -> Image.Image:
    """Draw a map from above, +x right and +z down, with its things and an arrow at the pose.

    Of a building, the floor at the pose is drawn, or the lowest floor without a pose.
    """
    floor = world_map
    if world_map.levels:
        height = world_map.levels[0] if pose is None else pose.y
        floor = world_map.plan_of(world_map.floor_at(height))
    x0, z0, x1, z1 = floor.bounds
    scale = (LONG_SIDE_PX - 2 * MARGIN_PX) / max(x1 - x0, z1 - z0, _MIN_EXTENT)  # px per cell or metre

    def to_pixel(x: float, z: float) -> tuple[float, float]:
        return (MARGIN_PX + (x - x0) * scale, MARGIN_PX + (z - z0) * scale)

    right, bottom = to_pixel(x1, z1)
    image = Image.new("RGB", (math.ceil(right) + MARGIN_PX, math.ceil(bottom) + MARGIN_PX), PAPER)
    draw = ImageDraw.Draw(image)
    draw.rectangle((*to_pixel(x0, z0), right, bottom), fill=FLOOR)
    for wall in floor.walls:
        draw.line((*to_pixel(wall[0], wall[1]), *to_pixel(wall[2], wall[3])), fill=WALL, width=3)
    for thing in floor.things:
        x, z = to_pixel(thing.x, thing.z)
        radius = max(thing.radius * scale, 2.0)
        draw.ellipse((x - radius, z - radius, x + radius, z + radius), fill=thing.colour, outline=WALL)
    if pose is not None:
        corners = _find_arrow_corners(pose, max(_ARROW_RADIUS, ARROW_PX / scale))
        draw.polygon([to_pixel(x, z) for x, z in corners], fill=AGENT)
    return image


def _find_arrow_corners(pose: Pose, radius: float) -> list[tuple[float, float]]:
    """Return the three corners (x, z) of an arrowhead at a pose, with the tip in its direction of view.

    Args:
        pose: the pose of the agent.
        radius: the distance of each corner from the pose, in cells or metres.
    """
    angles = (pose.yaw_rad, pose.yaw_rad + _ARROW_BACK_RAD, pose.yaw_rad - _ARROW_BACK_RAD)
    return [(pose.x + radius * math.cos(angle), pose.z - radius * math.sin(angle)) for angle in angles]
