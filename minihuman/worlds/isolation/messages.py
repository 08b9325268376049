"""What the host of a session and the process of a world tell each other: one request, one reply, as MessagePack.

A picture does not travel in a message: it lies in shared memory that the host made.
"""

import msgspec

from minihuman.worlds.adapters.spaces import Action


class Request(msgspec.Struct, frozen=True, tag=True, array_like=True):
    """What the host wants."""


class Construct(Request, frozen=True):
    """Make the world; the host has found that it is trusted."""

    world_id: str
    options: bytes  # by `value_codec`, with the files that they refer to
    search_path: list[str]  # where Python looks for modules
    module: str  # where the host's registry has it from, for an id that names none; "" if that does not know it


class Reset(Request, frozen=True):
    """Begin an episode."""

    seed: int


class Step(Request, frozen=True):
    """Do an action."""

    action: Action


class Advance(Request, frozen=True):
    """Do an action without an observation."""

    action: Action


class Draw(Request, frozen=True):
    """Draw the picture into shared memory."""

    view: str
    size_px: tuple[int, int]
    palette: str
    memory: str  # the name of the shared memory; "": there is none yet


class Save(Request, frozen=True):
    """Keep a copy of the state under a number."""

    number: int


class Restore(Request, frozen=True):
    """Go back to a copy."""

    number: int


class Forget(Request, frozen=True):
    """Let go of copies."""

    numbers: list[int]


class Query(Request, frozen=True):
    """Ask for what is seldom needed, by its name in `World`."""

    name: str


class ReadSuccess(Request, frozen=True):
    """Read what the last step's ``info`` says of success, under a key; "": where the usual keys are."""

    key: str


class EncodeInfo(Request, frozen=True):
    """Encode chosen keys of the last step's ``info`` as JSON."""

    keys: list[str]


class Close(Request, frozen=True):
    """Close the environment; the process may be used again for the same world."""


AnyRequest = (
    Construct | Reset | Step | Advance | Draw | Save | Restore | Forget | Query | ReadSuccess | EncodeInfo | Close
)


class Description(msgspec.Struct, frozen=True, array_like=True):
    """What does not change of a world."""

    can_isolate: bool  # else it is made where its session is: a page computes it, or it has several bodies
    action_names: tuple[str, ...]
    first_action: int  # of a Discrete space: the space's own number
    chords: list[tuple[list[int], int]]
    action_space: bytes  # by `space_codec`
    observation_space: bytes
    drawn: bool
    reward_means_success: bool


class StateReport(msgspec.Struct, frozen=True, array_like=True):
    """Where the world is."""

    state_hash: int
    scene_hash: int | None  # None: it takes a query
    pose: tuple[float, float, float, float] | None
    subgoals: tuple[tuple[str, int], ...]


class ResetReport(msgspec.Struct, frozen=True, array_like=True):
    """What a reset gave."""

    observation_hash: int
    mission: str
    onset: bool
    moment: StateReport


class StepReport(msgspec.Struct, frozen=True, array_like=True):
    """What a step gave."""

    reward: float
    terminated: bool
    truncated: bool
    observation_hash: int
    onset: bool
    is_own: bool
    moment: StateReport


class Reply(msgspec.Struct, frozen=True, array_like=True):
    """The answer to a request: what it gave, or why it failed."""

    answer: bytes  # of the type that belongs to the request
    error: str = ""  # what the world's failure is called
    cause: str = ""  # what its code raised, as a log has it; "" where it raised nothing
    cpu_s: float = 0.0  # that the process has used
    peak_bytes: int = 0  # the most memory that it had
