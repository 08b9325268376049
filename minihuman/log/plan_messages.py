"""Plans, maps and poses as messages, and back. What goes in comes out equal."""

from operator import attrgetter
from typing import Any

import msgspec

from minihuman.errors import LogError, ProtocolError
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.study.activities.registry import kind_of
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
from minihuman.study.words import ENGLISH
from minihuman.worlds.pose import Map, Pose, Thing


def one_of(allowed: tuple[str, ...], value: str) -> Any:
    """Pass a word of a fixed vocabulary (a ``Literal``'s arguments) through.

    Raises:
        LogError: if the word is not of the vocabulary.
    """
    if value not in allowed:
        raise LogError(f"the log says {value!r} where one of {', '.join(allowed)} belongs; it is damaged or newer")
    return value


def pose_message(pose: Pose) -> v1.Pose:
    """Put a pose into its message."""
    return v1.Pose(x=pose.x, y=pose.y, z=pose.z, yaw_rad=pose.yaw_rad)


def read_pose(message: v1.Pose) -> Pose:
    """Read a pose."""
    return Pose(message.x, message.y, message.z, message.yaw_rad)


def map_message(floor: Map) -> v1.Map:
    """Put a map into its message."""
    return v1.Map(
        unit=floor.unit,
        bounds=_wall_message(floor.bounds),
        walls=[_wall_message(wall) for wall in floor.walls],
        things=[
            v1.Thing(name=thing.name, x=thing.x, z=thing.z, radius=thing.radius, colour=thing.colour)
            for thing in floor.things
        ],
    )


_read_wall = attrgetter("x0", "z0", "x1", "z1")


def read_map(message: v1.Map) -> Map:
    """Read a map."""
    return Map(
        unit=one_of(("cell", "m"), message.unit),
        bounds=_read_wall(message.bounds),
        walls=tuple(map(_read_wall, message.walls)),
        things=tuple(Thing(thing.name, thing.x, thing.z, thing.radius, thing.colour) for thing in message.things),
    )


def _wall_message(wall: tuple[float, float, float, float]) -> v1.Wall:
    x0, z0, x1, z1 = wall
    return v1.Wall(x0=x0, z0=z0, x1=x1, z1=z1)


def key_map_message(key_map: KeyMap) -> v1.KeyMap:
    """Put a key map into its message."""
    return v1.KeyMap(
        keys=[v1.Binding(key=key, action=action) for key, action in key_map.keys.items()],
        spare_keys=key_map.spare_keys,
        spare=key_map.spare,
        seed=key_map.seed,
    )


def read_key_map(message: v1.KeyMap) -> KeyMap:
    """Read a key map."""
    return KeyMap(
        keys={binding.key: binding.action for binding in message.keys},
        spare_keys=tuple(message.spare_keys),
        spare=one_of(("ignore", "distractor"), message.spare),
        seed=message.seed,
    )


def episode_plan_message(plan: EpisodePlan) -> v1.EpisodePlan:
    """Put an episode's plan into its message."""
    fields = {name: getattr(plan, name) for name in plan.__struct_fields__}
    fields["key_map"] = key_map_message(fields["key_map"])
    fields["options_json"] = msgspec.json.encode(fields.pop("options")).decode()
    return v1.EpisodePlan(**fields)


def read_episode_plan(message: v1.EpisodePlan) -> EpisodePlan:
    """Read an episode's plan."""
    return EpisodePlan(
        episode=message.episode,
        block=message.block,
        block_name=message.block_name,
        episode_in_block=message.episode_in_block,
        episodes_in_block=message.episodes_in_block,
        world=message.world,
        options=msgspec.json.decode(message.options_json),
        seed=message.seed,
        actions=tuple(message.actions),
        key_map=read_key_map(message.key_map),
        show_keys=message.show_keys,
        pace=one_of(("on_key", "real_time"), message.pace),
        step_period_ms=message.step_period_ms,
        noop=message.noop if message.HasField("noop") else None,
        auto_repeat=message.auto_repeat,
        max_steps=message.max_steps,
        view=one_of(("partial", "full"), message.view),
        palette=one_of(("classic", "colour-safe"), message.palette),
        record_observations=message.record_observations,
    )


def session_plan_message(plan: SessionPlan, *, t_ns: int, facts: dict[str, str]) -> v1.SessionPlan:
    """Put a session's plan and the station's facts into their message."""
    fields = {name: getattr(plan, name) for name in plan.__struct_fields__}
    fields["participant"] = v1.Participant(**msgspec.structs.asdict(plan.participant))
    fields["texts"] = [
        v1.BlockText(instruction=text.instruction, feedback=text.feedback, rest=text.rest, rest_s=text.rest_s)
        for text in plan.texts
    ]
    fields["parts"] = [
        v1.Part(kind=part.kind, name=part.name, plan_json=_json(part.plan)) for part in fields.pop("parts")
    ]
    fields["words_json"] = _json(fields.pop("words"))
    fields["standing_json"] = _json(fields.pop("standing"))
    fields["bonus_json"] = _json(fields.pop("bonus"))
    fields["episodes"] = [episode_plan_message(episode) for episode in plan.episodes]
    return v1.SessionPlan(t_ns=t_ns, facts=[v1.Fact(name=name, value=value) for name, value in facts.items()], **fields)


def read_session_plan(message: v1.SessionPlan) -> SessionPlan:
    """Read a session's plan."""
    who = message.participant
    slot = who.slot if who.HasField("slot") else None
    return SessionPlan(
        study=message.study,
        study_version=message.study_version,
        protocol_toml=message.protocol_toml,
        protocol_sha256=message.protocol_sha256,
        participant=Participant(who.id, who.index, who.group, who.stratum, slot),
        session=message.session,
        study_seed=message.study_seed,
        allocation_sha256=message.allocation_sha256 if message.HasField("allocation_sha256") else None,
        overridden=message.overridden,
        consent_text=message.consent_text,
        consent_sha256=message.consent_sha256,
        key_pool=tuple(message.key_pool),
        keyboard_check=message.keyboard_check,
        texts=tuple(BlockText(text.instruction, text.feedback, text.rest, text.rest_s) for text in message.texts),
        closing_text=message.closing_text,
        episodes=tuple(read_episode_plan(episode) for episode in message.episodes),
        first_episode=message.first_episode,
        segment=message.segment,
        parts=tuple(_read_part(part) for part in message.parts),
        words=msgspec.json.decode(message.words_json) if message.words_json else {},
        language=message.language or ENGLISH,
        standing=msgspec.json.decode(message.standing_json or b"{}", type=Standing),
        bonus=msgspec.json.decode(message.bonus_json or b"null", type=Bonus | None),
        fonts=tuple(message.fonts),
    )


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _read_part(message: v1.Part) -> Part:
    """A part as its kind reads it; as plain JSON where this machine has no such kind, so that the log opens even so."""
    plan = msgspec.json.decode(message.plan_json)
    try:
        return Part(message.kind, message.name, kind_of(message.kind).read(plan))
    except ProtocolError:
        return Part(message.kind, message.name, plan)
