"""The messages between a session's host and a world's process: one request, one reply, as MessagePack.

Pictures are not part of a message: they are in shared memory that the host allocates.
"""

import msgspec

from minihuman.worlds.adapters.spaces import Action


class Request(msgspec.Struct, frozen=True, tag=True, array_like=True):
    """A request of the host."""


class Construct(Request, frozen=True):
    """A request to make the world, which the host has found to be trusted."""

    world_id: str
    options: bytes  # encoded by `value_codec`, with the contents of the files that they refer to
    search_path: list[str]  # where Python looks for modules
    module: str  # the module that registered the world in the host, or that its id names; "" if unknown


class Reset(Request, frozen=True):
    """A request to begin an episode."""

    seed: int


class Step(Request, frozen=True):
    """A request to step the world by an action."""

    action: Action


class Advance(Request, frozen=True):
    """A request to step the world without computing an observation."""

    action: Action


class Draw(Request, frozen=True):
    """A request to draw the picture into shared memory."""

    view: str
    size_px: tuple[int, int]
    palette: str
    memory: str  # the name of the shared memory; "": there is none yet


class Save(Request, frozen=True):
    """A request to keep a copy of the state under a number."""

    number: int


class Restore(Request, frozen=True):
    """A request to restore a copy of the state."""

    number: int


class Forget(Request, frozen=True):
    """A request to delete copies of the state."""

    numbers: list[int]


class Query(Request, frozen=True):
    """A request for a rarely needed attribute, named as in `World`."""

    name: str


class ReadSuccess(Request, frozen=True):
    """A request to read success from the last step's ``info`` under a key; "" reads the usual keys."""

    key: str


class EncodeInfo(Request, frozen=True):
    """A request for chosen keys of the last step's ``info`` as JSON."""

    keys: list[str]


class Close(Request, frozen=True):
    """A request to close the environment; the process can then run the same world again."""


AnyRequest = (
    Construct | Reset | Step | Advance | Draw | Save | Restore | Forget | Query | ReadSuccess | EncodeInfo | Close
)


class Description(msgspec.Struct, frozen=True, array_like=True):
    """The constant properties of a world."""

    can_isolate: bool  # False if a page computes the world or it has several bodies: its session's process makes it
    action_names: tuple[str, ...]
    first_action: int  # of a Discrete space, its own number of the first action
    action_resolution: int  # into how many parts of 1 vectors are rounded; 0: they are not
    chords: list[tuple[list[int], int]]
    action_space: bytes  # encoded by `space_codec`
    observation_space: bytes
    drawn: bool
    reward_means_success: bool


class StateReport(msgspec.Struct, frozen=True, array_like=True):
    """The part of a world's present state that the host needs at every step."""

    state_hash: int
    scene_hash: int | None  # None: it takes a query
    pose: tuple[float, float, float, float] | None
    subgoals: tuple[tuple[str, int], ...]


class ResetReport(msgspec.Struct, frozen=True, array_like=True):
    """The result of a reset."""

    observation_hash: int
    mission: str
    onset: bool
    moment: StateReport


class StepReport(msgspec.Struct, frozen=True, array_like=True):
    """The result of a step."""

    reward: float
    terminated: bool
    truncated: bool
    observation_hash: int
    onset: bool
    is_own: bool
    moment: StateReport


class Reply(msgspec.Struct, frozen=True, array_like=True):
    """The reply to a request: the answer, or the reason why it failed."""

    answer: bytes  # of the type that belongs to the request
    error: str = ""  # the error's message; "" if the request succeeded
    cause: str = ""  # the error's text for a log; "" unless the world's code raised it
    cpu_s: float = 0.0  # CPU time that the process has used
    peak_bytes: int = 0  # the most memory that it has used
