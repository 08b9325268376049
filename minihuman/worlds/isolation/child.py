"""The main loop of a process that runs one world: it receives requests and sends replies.

The process ends with the program that started it.
"""

import os
import sys
import threading
from collections.abc import Mapping
from importlib import import_module
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.shared_memory import SharedMemory
from typing import Any, assert_never

import gymnasium
import msgspec
import numpy as np

from minihuman.errors import MinihumanError, WorldError
from minihuman.operating_system import (
    end_with_parent,
    lead_own_group,
    limit_memory_bytes,
    measure_own_use,
    outlive_termination,
)
from minihuman.worlds.adapters.foreign_code import WorldCodeError, contain_errors
from minihuman.worlds.adapters.seat import SeatEnv
from minihuman.worlds.adapters.spaces import DiscreteActions
from minihuman.worlds.adapters.success import encode_info, read_success
from minihuman.worlds.adapters.transition import StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation import messages
from minihuman.worlds.isolation.space_codec import encode_space
from minihuman.worlds.value_codec import decode_value, encode_value

_QUERIES = ("map", "shortest_path", "path_length_bounds", "scene_hash", "text", "step_limit", "draws_itself")


def run_child(connection: Connection, memory_bytes: int) -> None:
    """Answer the host's requests until the connection is closed, then end this process.

    The process may use ``memory_bytes`` of memory.
    """
    lead_own_group()
    end_with_parent()
    outlive_termination()  # a service manager sends SIGTERM to all processes, but the host ends its sessions first
    threading.Thread(target=_end_after_parent, daemon=True).start()
    limit_memory_bytes(memory_bytes)
    server = WorldServer()
    decoder = msgspec.msgpack.Decoder(messages.AnyRequest)
    encode = msgspec.msgpack.Encoder().encode
    while True:
        try:
            request = decoder.decode(connection.recv_bytes())
        except EOFError:  # the host has ended, or has closed the connection
            break
        connection.send_bytes(encode(server.reply(request)))
    sys.stdout.flush()
    os._exit(0)  # no thread and no exit handler of a world's keeps the process


def _end_after_parent() -> None:
    """End this process when its parent ends, on systems that do not do so themselves."""
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(0)


class WorldServer:
    """A server that runs one world for a host."""

    def __init__(self) -> None:
        self._constructed: World | None = None
        self._stepped: StepResult | None = None
        self._saved: dict[int, Any] = {}
        self._memory: SharedMemory | None = None

    def reply(self, request: messages.AnyRequest) -> messages.Reply:
        """Execute a request and return the reply, which can also be an error of the world."""
        answer = b""
        error_text = cause = ""
        try:
            answer = msgspec.msgpack.encode(self._answer(request))
        except MinihumanError as error:
            error_text = str(error)
            if isinstance(error, WorldCodeError):
                cause = error.log_text
        cpu_s, peak_bytes = measure_own_use()
        return messages.Reply(answer, error_text, cause, cpu_s, peak_bytes)

    def _answer(self, request: messages.AnyRequest) -> Any:
        """Execute a request and return its answer."""
        match request:
            case messages.Construct():
                return self._construct(request)
            case messages.Reset():
                reset_result = self._world.reset(request.seed)
                return messages.ResetReport(
                    reset_result.observation_hash, reset_result.mission, reset_result.onset, self._report_state()
                )
            case messages.Step():
                return self._step(request)
            case messages.Advance():
                return *self._world.advance(request.action), self._report_state()
            case messages.Draw():
                return self._draw(request)
            case messages.Save():
                self._saved[request.number] = self._world.save()
            case messages.Restore():
                self._world.restore(self._saved[request.number])
                return self._report_state()
            case messages.Forget():
                for number in request.numbers:
                    del self._saved[number]
            case messages.Query():
                return self._query(request.name)
            case messages.ReadSuccess():
                with contain_errors(self._world.id, "info"):
                    return read_success(self._last_info, request.key)
            case messages.EncodeInfo():
                with contain_errors(self._world.id, "info"):
                    return encode_info(self._last_info, request.keys)
            case messages.Close():
                self._close()
            case _:
                assert_never(request)
        return None

    @property
    def _world(self) -> World:
        assert self._constructed is not None, "the host constructs a world first"
        return self._constructed

    @property
    def _last_info(self) -> Mapping[str, Any]:
        assert self._stepped is not None, "the host asks after a step"
        return self._stepped.info

    def _construct(self, request: messages.Construct) -> messages.Description:
        """Make the world and return its constant properties."""
        sys.path[:] = request.search_path
        if request.module and request.world_id not in gymnasium.registry:
            with contain_errors(request.world_id, "its code"):
                import_module(request.module)
        self._constructed = world = World(request.world_id, decode_value(request.options), trusted=True)
        actions = world.actions
        discrete = DiscreteActions((), 0, {})
        resolution = 0
        if isinstance(actions, DiscreteActions):
            discrete = actions
        else:
            resolution = actions.resolution
        return messages.Description(
            can_isolate=not world.is_compiled and not isinstance(world.unwrapped, SeatEnv),
            action_names=actions.names,
            first_action=discrete.first,
            action_resolution=resolution,
            chords=[(sorted(keys), action) for keys, action in discrete.chords.items()],
            action_space=encode_space(world.action_space),
            observation_space=encode_space(world.observation_space),
            drawn=world.drawn,
            reward_means_success=world.reward_means_success,
        )

    def _step(self, request: messages.Step) -> messages.StepReport:
        """Step the world and report the result."""
        self._stepped = result = self._world.step(request.action)
        return messages.StepReport(
            result.reward,
            result.terminated,
            result.truncated,
            result.observation_hash,
            result.onset,
            result.is_own,
            self._report_state(),
        )

    def _report_state(self) -> messages.StateReport:
        """Return the part of the present state that the host needs at every step."""
        world = self._world
        pose = world.pose()
        if pose is None:
            pose_numbers = None
        else:
            pose_numbers = (pose.x, pose.y, pose.z, pose.yaw_rad)
        state_hash = world.state_hash()
        scene_hash = None if world.knows_state else state_hash
        return messages.StateReport(state_hash, scene_hash, pose_numbers, world.subgoals())

    def _draw(self, request: messages.Draw) -> tuple[tuple[int, ...], bool]:
        """Draw the picture into shared memory; return its shape, and False if the memory is too small."""
        picture = self._world.frame(request.view, request.size_px, request.palette)  # type: ignore[arg-type]
        if self._memory is None or self._memory.name != request.memory:
            if self._memory is not None:
                self._memory.close()
            if request.memory:
                self._memory = SharedMemory(request.memory)
            else:
                self._memory = None
        if self._memory is None or self._memory.size < picture.nbytes:
            return picture.shape, False
        np.ndarray(picture.shape, np.uint8, self._memory.buf)[...] = picture
        return picture.shape, True

    def _query(self, name: str) -> Any:
        """Return an attribute of the world, or the result of calling it.

        Raises:
            WorldError: if the observation is queried and cannot be encoded.
        """
        if name == "observation":
            try:
                return encode_value(self._world.observation)
            except (TypeError, OverflowError) as error:
                raise WorldError(f"{self._world.id}: its observation cannot be stored: {error}") from error
        assert name in _QUERIES, name
        attribute = getattr(self._world, name)
        if callable(attribute):
            return attribute()
        return attribute

    def _close(self) -> None:
        """Close the world and delete the saved states."""
        self._saved.clear()
        if self._constructed is not None:
            self._constructed.close()
            self._constructed = None
