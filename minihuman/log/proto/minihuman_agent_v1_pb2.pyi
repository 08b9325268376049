from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class PolicyGiven(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "policy", "failure")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    FAILURE_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    policy: str
    failure: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., policy: _Optional[str] = ..., failure: _Optional[str] = ...) -> None: ...

class LearnerAsked(_message.Message):
    __slots__ = ("t_ns", "part", "episode")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ...) -> None: ...

class Advised(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "action", "probabilities")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    PROBABILITIES_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    action: int
    probabilities: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., action: _Optional[int] = ..., probabilities: _Optional[_Iterable[float]] = ...) -> None: ...

class ControlChanged(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "who", "reason", "pressed_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    PRESSED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    who: str
    reason: str
    pressed_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., who: _Optional[str] = ..., reason: _Optional[str] = ..., pressed_ns: _Optional[int] = ...) -> None: ...

class Rated(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "value", "pressed_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    PRESSED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    value: float
    pressed_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., value: _Optional[float] = ..., pressed_ns: _Optional[int] = ...) -> None: ...

class StretchShown(_message.Message):
    __slots__ = ("t_ns", "part", "pair", "side", "episode", "attempt", "first", "world", "options", "seed", "actions", "first_hash", "last_hash")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PAIR_FIELD_NUMBER: _ClassVar[int]
    SIDE_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    FIRST_HASH_FIELD_NUMBER: _ClassVar[int]
    LAST_HASH_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    pair: int
    side: str
    episode: int
    attempt: int
    first: int
    world: str
    options: str
    seed: int
    actions: _containers.RepeatedScalarFieldContainer[int]
    first_hash: int
    last_hash: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., pair: _Optional[int] = ..., side: _Optional[str] = ..., episode: _Optional[int] = ..., attempt: _Optional[int] = ..., first: _Optional[int] = ..., world: _Optional[str] = ..., options: _Optional[str] = ..., seed: _Optional[int] = ..., actions: _Optional[_Iterable[int]] = ..., first_hash: _Optional[int] = ..., last_hash: _Optional[int] = ...) -> None: ...

class NothingToCompare(_message.Message):
    __slots__ = ("t_ns", "part", "pair")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PAIR_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    pair: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., pair: _Optional[int] = ...) -> None: ...

class Preferred(_message.Message):
    __slots__ = ("t_ns", "part", "pair", "answer", "shown_ns", "replays", "pressed_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PAIR_FIELD_NUMBER: _ClassVar[int]
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    SHOWN_NS_FIELD_NUMBER: _ClassVar[int]
    REPLAYS_FIELD_NUMBER: _ClassVar[int]
    PRESSED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    pair: int
    answer: str
    shown_ns: int
    replays: int
    pressed_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., pair: _Optional[int] = ..., answer: _Optional[str] = ..., shown_ns: _Optional[int] = ..., replays: _Optional[int] = ..., pressed_ns: _Optional[int] = ...) -> None: ...

class PairSeen(_message.Message):
    __slots__ = ("t_ns", "part", "pair", "step", "submit_ns", "flip_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PAIR_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    pair: int
    step: int
    submit_ns: int
    flip_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., pair: _Optional[int] = ..., step: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ...) -> None: ...

class EpisodeLookedAt(_message.Message):
    __slots__ = ("t_ns", "part", "number", "episode", "attempt", "world", "options", "seed", "actions", "last_hash")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    LAST_HASH_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    number: int
    episode: int
    attempt: int
    world: str
    options: str
    seed: int
    actions: _containers.RepeatedScalarFieldContainer[int]
    last_hash: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., number: _Optional[int] = ..., episode: _Optional[int] = ..., attempt: _Optional[int] = ..., world: _Optional[str] = ..., options: _Optional[str] = ..., seed: _Optional[int] = ..., actions: _Optional[_Iterable[int]] = ..., last_hash: _Optional[int] = ...) -> None: ...

class NothingToCorrect(_message.Message):
    __slots__ = ("t_ns", "part", "number")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    number: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., number: _Optional[int] = ...) -> None: ...

class CorrectionSeen(_message.Message):
    __slots__ = ("t_ns", "part", "number", "step", "submit_ns", "flip_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    number: int
    step: int
    submit_ns: int
    flip_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., number: _Optional[int] = ..., step: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ...) -> None: ...

class CorrectionBegun(_message.Message):
    __slots__ = ("t_ns", "part", "correction", "episode", "attempt", "step", "state_hash", "pressed_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    PRESSED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    correction: int
    episode: int
    attempt: int
    step: int
    state_hash: int
    pressed_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., correction: _Optional[int] = ..., episode: _Optional[int] = ..., attempt: _Optional[int] = ..., step: _Optional[int] = ..., state_hash: _Optional[int] = ..., pressed_ns: _Optional[int] = ...) -> None: ...

class CorrectionStepped(_message.Message):
    __slots__ = ("t_ns", "part", "correction", "episode", "step", "action", "key", "key_t_ns", "reward", "terminated", "truncated", "state_hash")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    KEY_T_NS_FIELD_NUMBER: _ClassVar[int]
    REWARD_FIELD_NUMBER: _ClassVar[int]
    TERMINATED_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    correction: int
    episode: int
    step: int
    action: int
    key: str
    key_t_ns: int
    reward: float
    terminated: bool
    truncated: bool
    state_hash: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., correction: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., action: _Optional[int] = ..., key: _Optional[str] = ..., key_t_ns: _Optional[int] = ..., reward: _Optional[float] = ..., terminated: bool = ..., truncated: bool = ..., state_hash: _Optional[int] = ...) -> None: ...

class CorrectionEnded(_message.Message):
    __slots__ = ("t_ns", "part", "correction", "episode", "outcome")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    correction: int
    episode: int
    outcome: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., correction: _Optional[int] = ..., episode: _Optional[int] = ..., outcome: _Optional[str] = ...) -> None: ...
