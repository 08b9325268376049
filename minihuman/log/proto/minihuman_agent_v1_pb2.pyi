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

class TeamFormed(_message.Message):
    __slots__ = ("t_ns", "part", "team", "index", "seat", "role", "seats", "salt")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    TEAM_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    SEAT_FIELD_NUMBER: _ClassVar[int]
    ROLE_FIELD_NUMBER: _ClassVar[int]
    SEATS_FIELD_NUMBER: _ClassVar[int]
    SALT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    team: str
    index: int
    seat: int
    role: str
    seats: _containers.RepeatedScalarFieldContainer[str]
    salt: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., team: _Optional[str] = ..., index: _Optional[int] = ..., seat: _Optional[int] = ..., role: _Optional[str] = ..., seats: _Optional[_Iterable[str]] = ..., salt: _Optional[str] = ...) -> None: ...

class SeatsReadied(_message.Message):
    __slots__ = ("t_ns", "episode", "poses")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    poses: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., poses: _Optional[_Iterable[float]] = ...) -> None: ...

class JointStepped(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "actions", "rewards", "sources", "digest", "poses", "silent_ms")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    REWARDS_FIELD_NUMBER: _ClassVar[int]
    SOURCES_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    POSES_FIELD_NUMBER: _ClassVar[int]
    SILENT_MS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    actions: _containers.RepeatedScalarFieldContainer[int]
    rewards: _containers.RepeatedScalarFieldContainer[float]
    sources: _containers.RepeatedScalarFieldContainer[str]
    digest: int
    poses: _containers.RepeatedScalarFieldContainer[float]
    silent_ms: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., actions: _Optional[_Iterable[int]] = ..., rewards: _Optional[_Iterable[float]] = ..., sources: _Optional[_Iterable[str]] = ..., digest: _Optional[int] = ..., poses: _Optional[_Iterable[float]] = ..., silent_ms: _Optional[_Iterable[int]] = ...) -> None: ...

class InputLate(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "action", "key", "key_t_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    KEY_T_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    action: int
    key: str
    key_t_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., action: _Optional[int] = ..., key: _Optional[str] = ..., key_t_ns: _Optional[int] = ...) -> None: ...

class PictureCorrected(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "submit_ns", "flip_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    submit_ns: int
    flip_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ...) -> None: ...

class SeatTaken(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "seat", "by")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SEAT_FIELD_NUMBER: _ClassVar[int]
    BY_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    seat: int
    by: str
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., seat: _Optional[int] = ..., by: _Optional[str] = ...) -> None: ...

class SeatSeen(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "seat", "state", "for_ms")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SEAT_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FOR_MS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    seat: int
    state: str
    for_ms: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., seat: _Optional[int] = ..., state: _Optional[str] = ..., for_ms: _Optional[int] = ...) -> None: ...

class TeamEnded(_message.Message):
    __slots__ = ("t_ns", "part", "reason")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    reason: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class MessageTyped(_message.Message):
    __slots__ = ("t_ns", "text")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    text: str
    def __init__(self, t_ns: _Optional[int] = ..., text: _Optional[str] = ...) -> None: ...

class MessageEdited(_message.Message):
    __slots__ = ("t_ns", "text", "changes", "keys", "waited_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    CHANGES_FIELD_NUMBER: _ClassVar[int]
    KEYS_FIELD_NUMBER: _ClassVar[int]
    WAITED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    text: str
    changes: _containers.RepeatedScalarFieldContainer[str]
    keys: int
    waited_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., text: _Optional[str] = ..., changes: _Optional[_Iterable[str]] = ..., keys: _Optional[int] = ..., waited_ns: _Optional[int] = ...) -> None: ...

class MessageShown(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "seat", "text", "cell", "digest")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SEAT_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    CELL_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    seat: int
    text: str
    cell: _containers.RepeatedScalarFieldContainer[float]
    digest: str
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., seat: _Optional[int] = ..., text: _Optional[str] = ..., cell: _Optional[_Iterable[float]] = ..., digest: _Optional[str] = ...) -> None: ...

class ModelCall(_message.Message):
    __slots__ = ("t_ns", "call", "state", "episode", "step", "screen", "attempt", "prompt_sha256", "picture_sha256", "provider", "model", "temperature", "max_tokens", "prompt_tokens", "completion_tokens", "price", "latency_ms", "answer", "reasoning", "finish_reason", "verdict", "reading", "error")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    CALL_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SCREEN_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    PROMPT_SHA256_FIELD_NUMBER: _ClassVar[int]
    PICTURE_SHA256_FIELD_NUMBER: _ClassVar[int]
    PROVIDER_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_FIELD_NUMBER: _ClassVar[int]
    MAX_TOKENS_FIELD_NUMBER: _ClassVar[int]
    PROMPT_TOKENS_FIELD_NUMBER: _ClassVar[int]
    COMPLETION_TOKENS_FIELD_NUMBER: _ClassVar[int]
    PRICE_FIELD_NUMBER: _ClassVar[int]
    LATENCY_MS_FIELD_NUMBER: _ClassVar[int]
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    REASONING_FIELD_NUMBER: _ClassVar[int]
    FINISH_REASON_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    READING_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    call: int
    state: str
    episode: int
    step: int
    screen: str
    attempt: int
    prompt_sha256: str
    picture_sha256: str
    provider: str
    model: str
    temperature: float
    max_tokens: int
    prompt_tokens: int
    completion_tokens: int
    price: float
    latency_ms: float
    answer: str
    reasoning: str
    finish_reason: str
    verdict: str
    reading: str
    error: str
    def __init__(self, t_ns: _Optional[int] = ..., call: _Optional[int] = ..., state: _Optional[str] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., screen: _Optional[str] = ..., attempt: _Optional[int] = ..., prompt_sha256: _Optional[str] = ..., picture_sha256: _Optional[str] = ..., provider: _Optional[str] = ..., model: _Optional[str] = ..., temperature: _Optional[float] = ..., max_tokens: _Optional[int] = ..., prompt_tokens: _Optional[int] = ..., completion_tokens: _Optional[int] = ..., price: _Optional[float] = ..., latency_ms: _Optional[float] = ..., answer: _Optional[str] = ..., reasoning: _Optional[str] = ..., finish_reason: _Optional[str] = ..., verdict: _Optional[str] = ..., reading: _Optional[str] = ..., error: _Optional[str] = ...) -> None: ...

class DesignDecided(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "design", "version", "options_json", "seed", "stop", "estimates_json", "posterior")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    DESIGN_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_JSON_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    ESTIMATES_JSON_FIELD_NUMBER: _ClassVar[int]
    POSTERIOR_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    design: str
    version: int
    options_json: str
    seed: int
    stop: bool
    estimates_json: str
    posterior: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., design: _Optional[str] = ..., version: _Optional[int] = ..., options_json: _Optional[str] = ..., seed: _Optional[int] = ..., stop: bool = ..., estimates_json: _Optional[str] = ..., posterior: _Optional[int] = ...) -> None: ...
