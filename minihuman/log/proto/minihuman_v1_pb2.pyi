from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Participant(_message.Message):
    __slots__ = ("id", "index", "group", "stratum", "slot", "assigned_json")
    ID_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    GROUP_FIELD_NUMBER: _ClassVar[int]
    STRATUM_FIELD_NUMBER: _ClassVar[int]
    SLOT_FIELD_NUMBER: _ClassVar[int]
    ASSIGNED_JSON_FIELD_NUMBER: _ClassVar[int]
    id: str
    index: int
    group: str
    stratum: str
    slot: int
    assigned_json: str
    def __init__(self, id: _Optional[str] = ..., index: _Optional[int] = ..., group: _Optional[str] = ..., stratum: _Optional[str] = ..., slot: _Optional[int] = ..., assigned_json: _Optional[str] = ...) -> None: ...

class Binding(_message.Message):
    __slots__ = ("key", "action")
    KEY_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    key: str
    action: str
    def __init__(self, key: _Optional[str] = ..., action: _Optional[str] = ...) -> None: ...

class KeyMap(_message.Message):
    __slots__ = ("keys", "spare_keys", "spare", "seed")
    KEYS_FIELD_NUMBER: _ClassVar[int]
    SPARE_KEYS_FIELD_NUMBER: _ClassVar[int]
    SPARE_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    keys: _containers.RepeatedCompositeFieldContainer[Binding]
    spare_keys: _containers.RepeatedScalarFieldContainer[str]
    spare: str
    seed: int
    def __init__(self, keys: _Optional[_Iterable[_Union[Binding, _Mapping]]] = ..., spare_keys: _Optional[_Iterable[str]] = ..., spare: _Optional[str] = ..., seed: _Optional[int] = ...) -> None: ...

class EpisodePlan(_message.Message):
    __slots__ = ("episode", "block", "block_name", "episode_in_block", "episodes_in_block", "world", "options_json", "seed", "actions", "key_map", "show_keys", "pace", "step_period_ms", "noop", "auto_repeat", "max_steps", "view", "palette", "record_observations", "onset_at_reset", "hold", "response_deadline_ms", "outcome_rule", "record_info", "labels_json")
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    BLOCK_FIELD_NUMBER: _ClassVar[int]
    BLOCK_NAME_FIELD_NUMBER: _ClassVar[int]
    EPISODE_IN_BLOCK_FIELD_NUMBER: _ClassVar[int]
    EPISODES_IN_BLOCK_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_JSON_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    KEY_MAP_FIELD_NUMBER: _ClassVar[int]
    SHOW_KEYS_FIELD_NUMBER: _ClassVar[int]
    PACE_FIELD_NUMBER: _ClassVar[int]
    STEP_PERIOD_MS_FIELD_NUMBER: _ClassVar[int]
    NOOP_FIELD_NUMBER: _ClassVar[int]
    AUTO_REPEAT_FIELD_NUMBER: _ClassVar[int]
    MAX_STEPS_FIELD_NUMBER: _ClassVar[int]
    VIEW_FIELD_NUMBER: _ClassVar[int]
    PALETTE_FIELD_NUMBER: _ClassVar[int]
    RECORD_OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    ONSET_AT_RESET_FIELD_NUMBER: _ClassVar[int]
    HOLD_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_DEADLINE_MS_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_RULE_FIELD_NUMBER: _ClassVar[int]
    RECORD_INFO_FIELD_NUMBER: _ClassVar[int]
    LABELS_JSON_FIELD_NUMBER: _ClassVar[int]
    episode: int
    block: int
    block_name: str
    episode_in_block: int
    episodes_in_block: int
    world: str
    options_json: str
    seed: int
    actions: _containers.RepeatedScalarFieldContainer[str]
    key_map: KeyMap
    show_keys: bool
    pace: str
    step_period_ms: float
    noop: str
    auto_repeat: bool
    max_steps: int
    view: str
    palette: str
    record_observations: bool
    onset_at_reset: bool
    hold: str
    response_deadline_ms: float
    outcome_rule: str
    record_info: _containers.RepeatedScalarFieldContainer[str]
    labels_json: str
    def __init__(self, episode: _Optional[int] = ..., block: _Optional[int] = ..., block_name: _Optional[str] = ..., episode_in_block: _Optional[int] = ..., episodes_in_block: _Optional[int] = ..., world: _Optional[str] = ..., options_json: _Optional[str] = ..., seed: _Optional[int] = ..., actions: _Optional[_Iterable[str]] = ..., key_map: _Optional[_Union[KeyMap, _Mapping]] = ..., show_keys: bool = ..., pace: _Optional[str] = ..., step_period_ms: _Optional[float] = ..., noop: _Optional[str] = ..., auto_repeat: bool = ..., max_steps: _Optional[int] = ..., view: _Optional[str] = ..., palette: _Optional[str] = ..., record_observations: bool = ..., onset_at_reset: bool = ..., hold: _Optional[str] = ..., response_deadline_ms: _Optional[float] = ..., outcome_rule: _Optional[str] = ..., record_info: _Optional[_Iterable[str]] = ..., labels_json: _Optional[str] = ...) -> None: ...

class BlockText(_message.Message):
    __slots__ = ("instruction", "feedback", "rest", "rest_s")
    INSTRUCTION_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_FIELD_NUMBER: _ClassVar[int]
    REST_FIELD_NUMBER: _ClassVar[int]
    REST_S_FIELD_NUMBER: _ClassVar[int]
    instruction: str
    feedback: str
    rest: str
    rest_s: float
    def __init__(self, instruction: _Optional[str] = ..., feedback: _Optional[str] = ..., rest: _Optional[str] = ..., rest_s: _Optional[float] = ...) -> None: ...

class Fact(_message.Message):
    __slots__ = ("name", "value")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    name: str
    value: str
    def __init__(self, name: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...

class SessionPlan(_message.Message):
    __slots__ = ("t_ns", "study", "study_version", "protocol_toml", "protocol_sha256", "participant", "session", "study_seed", "allocation_sha256", "overridden", "consent_text", "consent_sha256", "key_pool", "keyboard_check", "texts", "closing_text", "episodes", "first_episode", "segment", "facts", "parts", "words_json", "language", "standing_json", "bonus_json", "fonts", "files", "outcome_rules")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    STUDY_FIELD_NUMBER: _ClassVar[int]
    STUDY_VERSION_FIELD_NUMBER: _ClassVar[int]
    PROTOCOL_TOML_FIELD_NUMBER: _ClassVar[int]
    PROTOCOL_SHA256_FIELD_NUMBER: _ClassVar[int]
    PARTICIPANT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    STUDY_SEED_FIELD_NUMBER: _ClassVar[int]
    ALLOCATION_SHA256_FIELD_NUMBER: _ClassVar[int]
    OVERRIDDEN_FIELD_NUMBER: _ClassVar[int]
    CONSENT_TEXT_FIELD_NUMBER: _ClassVar[int]
    CONSENT_SHA256_FIELD_NUMBER: _ClassVar[int]
    KEY_POOL_FIELD_NUMBER: _ClassVar[int]
    KEYBOARD_CHECK_FIELD_NUMBER: _ClassVar[int]
    TEXTS_FIELD_NUMBER: _ClassVar[int]
    CLOSING_TEXT_FIELD_NUMBER: _ClassVar[int]
    EPISODES_FIELD_NUMBER: _ClassVar[int]
    FIRST_EPISODE_FIELD_NUMBER: _ClassVar[int]
    SEGMENT_FIELD_NUMBER: _ClassVar[int]
    FACTS_FIELD_NUMBER: _ClassVar[int]
    PARTS_FIELD_NUMBER: _ClassVar[int]
    WORDS_JSON_FIELD_NUMBER: _ClassVar[int]
    LANGUAGE_FIELD_NUMBER: _ClassVar[int]
    STANDING_JSON_FIELD_NUMBER: _ClassVar[int]
    BONUS_JSON_FIELD_NUMBER: _ClassVar[int]
    FONTS_FIELD_NUMBER: _ClassVar[int]
    FILES_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_RULES_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    study: str
    study_version: str
    protocol_toml: bytes
    protocol_sha256: str
    participant: Participant
    session: int
    study_seed: int
    allocation_sha256: str
    overridden: bool
    consent_text: str
    consent_sha256: str
    key_pool: _containers.RepeatedScalarFieldContainer[str]
    keyboard_check: bool
    texts: _containers.RepeatedCompositeFieldContainer[BlockText]
    closing_text: str
    episodes: _containers.RepeatedCompositeFieldContainer[EpisodePlan]
    first_episode: int
    segment: int
    facts: _containers.RepeatedCompositeFieldContainer[Fact]
    parts: _containers.RepeatedCompositeFieldContainer[Part]
    words_json: str
    language: str
    standing_json: str
    bonus_json: str
    fonts: _containers.RepeatedScalarFieldContainer[str]
    files: _containers.RepeatedCompositeFieldContainer[ProtocolFile]
    outcome_rules: int
    def __init__(self, t_ns: _Optional[int] = ..., study: _Optional[str] = ..., study_version: _Optional[str] = ..., protocol_toml: _Optional[bytes] = ..., protocol_sha256: _Optional[str] = ..., participant: _Optional[_Union[Participant, _Mapping]] = ..., session: _Optional[int] = ..., study_seed: _Optional[int] = ..., allocation_sha256: _Optional[str] = ..., overridden: bool = ..., consent_text: _Optional[str] = ..., consent_sha256: _Optional[str] = ..., key_pool: _Optional[_Iterable[str]] = ..., keyboard_check: bool = ..., texts: _Optional[_Iterable[_Union[BlockText, _Mapping]]] = ..., closing_text: _Optional[str] = ..., episodes: _Optional[_Iterable[_Union[EpisodePlan, _Mapping]]] = ..., first_episode: _Optional[int] = ..., segment: _Optional[int] = ..., facts: _Optional[_Iterable[_Union[Fact, _Mapping]]] = ..., parts: _Optional[_Iterable[_Union[Part, _Mapping]]] = ..., words_json: _Optional[str] = ..., language: _Optional[str] = ..., standing_json: _Optional[str] = ..., bonus_json: _Optional[str] = ..., fonts: _Optional[_Iterable[str]] = ..., files: _Optional[_Iterable[_Union[ProtocolFile, _Mapping]]] = ..., outcome_rules: _Optional[int] = ...) -> None: ...

class ProtocolFile(_message.Message):
    __slots__ = ("name", "content")
    NAME_FIELD_NUMBER: _ClassVar[int]
    CONTENT_FIELD_NUMBER: _ClassVar[int]
    name: str
    content: bytes
    def __init__(self, name: _Optional[str] = ..., content: _Optional[bytes] = ...) -> None: ...

class Part(_message.Message):
    __slots__ = ("kind", "name", "plan_json")
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    PLAN_JSON_FIELD_NUMBER: _ClassVar[int]
    kind: str
    name: str
    plan_json: str
    def __init__(self, kind: _Optional[str] = ..., name: _Optional[str] = ..., plan_json: _Optional[str] = ...) -> None: ...

class Note(_message.Message):
    __slots__ = ("t_ns", "kind", "text")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    kind: str
    text: str
    def __init__(self, t_ns: _Optional[int] = ..., kind: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class Pause(_message.Message):
    __slots__ = ("t_ns", "paused", "reason")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PAUSED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    paused: bool
    reason: str
    def __init__(self, t_ns: _Optional[int] = ..., paused: bool = ..., reason: _Optional[str] = ...) -> None: ...

class SessionEnd(_message.Message):
    __slots__ = ("t_ns", "reason", "detail", "episodes_completed")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    EPISODES_COMPLETED_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    reason: str
    detail: str
    episodes_completed: int
    def __init__(self, t_ns: _Optional[int] = ..., reason: _Optional[str] = ..., detail: _Optional[str] = ..., episodes_completed: _Optional[int] = ...) -> None: ...

class KeyMapDrawn(_message.Message):
    __slots__ = ("t_ns", "episode", "key_map")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    KEY_MAP_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    key_map: KeyMap
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., key_map: _Optional[_Union[KeyMap, _Mapping]] = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("x", "y", "z", "yaw_rad")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    yaw_rad: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., yaw_rad: _Optional[float] = ...) -> None: ...

class Wall(_message.Message):
    __slots__ = ("x0", "z0", "x1", "z1")
    X0_FIELD_NUMBER: _ClassVar[int]
    Z0_FIELD_NUMBER: _ClassVar[int]
    X1_FIELD_NUMBER: _ClassVar[int]
    Z1_FIELD_NUMBER: _ClassVar[int]
    x0: float
    z0: float
    x1: float
    z1: float
    def __init__(self, x0: _Optional[float] = ..., z0: _Optional[float] = ..., x1: _Optional[float] = ..., z1: _Optional[float] = ...) -> None: ...

class Thing(_message.Message):
    __slots__ = ("name", "x", "z", "radius", "colour", "floor")
    NAME_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    COLOUR_FIELD_NUMBER: _ClassVar[int]
    FLOOR_FIELD_NUMBER: _ClassVar[int]
    name: str
    x: float
    z: float
    radius: float
    colour: str
    floor: int
    def __init__(self, name: _Optional[str] = ..., x: _Optional[float] = ..., z: _Optional[float] = ..., radius: _Optional[float] = ..., colour: _Optional[str] = ..., floor: _Optional[int] = ...) -> None: ...

class Map(_message.Message):
    __slots__ = ("unit", "bounds", "walls", "things", "levels", "wall_floors")
    UNIT_FIELD_NUMBER: _ClassVar[int]
    BOUNDS_FIELD_NUMBER: _ClassVar[int]
    WALLS_FIELD_NUMBER: _ClassVar[int]
    THINGS_FIELD_NUMBER: _ClassVar[int]
    LEVELS_FIELD_NUMBER: _ClassVar[int]
    WALL_FLOORS_FIELD_NUMBER: _ClassVar[int]
    unit: str
    bounds: Wall
    walls: _containers.RepeatedCompositeFieldContainer[Wall]
    things: _containers.RepeatedCompositeFieldContainer[Thing]
    levels: _containers.RepeatedScalarFieldContainer[float]
    wall_floors: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, unit: _Optional[str] = ..., bounds: _Optional[_Union[Wall, _Mapping]] = ..., walls: _Optional[_Iterable[_Union[Wall, _Mapping]]] = ..., things: _Optional[_Iterable[_Union[Thing, _Mapping]]] = ..., levels: _Optional[_Iterable[float]] = ..., wall_floors: _Optional[_Iterable[int]] = ...) -> None: ...

class EpisodeStart(_message.Message):
    __slots__ = ("t_ns", "plan", "action_names", "mission", "map", "pose", "state_hash", "observation_hash", "onset")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    ACTION_NAMES_FIELD_NUMBER: _ClassVar[int]
    MISSION_FIELD_NUMBER: _ClassVar[int]
    MAP_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_HASH_FIELD_NUMBER: _ClassVar[int]
    ONSET_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    plan: EpisodePlan
    action_names: _containers.RepeatedScalarFieldContainer[str]
    mission: str
    map: Map
    pose: Pose
    state_hash: int
    observation_hash: int
    onset: bool
    def __init__(self, t_ns: _Optional[int] = ..., plan: _Optional[_Union[EpisodePlan, _Mapping]] = ..., action_names: _Optional[_Iterable[str]] = ..., mission: _Optional[str] = ..., map: _Optional[_Union[Map, _Mapping]] = ..., pose: _Optional[_Union[Pose, _Mapping]] = ..., state_hash: _Optional[int] = ..., observation_hash: _Optional[int] = ..., onset: bool = ...) -> None: ...

class KeyEvent(_message.Message):
    __slots__ = ("t_ns", "key", "symbol", "down", "action", "verdict", "phase", "waited_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    SYMBOL_FIELD_NUMBER: _ClassVar[int]
    DOWN_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    WAITED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    key: str
    symbol: str
    down: bool
    action: int
    verdict: str
    phase: str
    waited_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., key: _Optional[str] = ..., symbol: _Optional[str] = ..., down: bool = ..., action: _Optional[int] = ..., verdict: _Optional[str] = ..., phase: _Optional[str] = ..., waited_ns: _Optional[int] = ...) -> None: ...

class Step(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "action", "key", "key_t_ns", "reward", "episode_return", "terminated", "truncated", "pose", "rt_ms", "state_hash", "observation_hash", "onset", "action_vector", "success", "info_json")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    KEY_T_NS_FIELD_NUMBER: _ClassVar[int]
    REWARD_FIELD_NUMBER: _ClassVar[int]
    EPISODE_RETURN_FIELD_NUMBER: _ClassVar[int]
    TERMINATED_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    RT_MS_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_HASH_FIELD_NUMBER: _ClassVar[int]
    ONSET_FIELD_NUMBER: _ClassVar[int]
    ACTION_VECTOR_FIELD_NUMBER: _ClassVar[int]
    SUCCESS_FIELD_NUMBER: _ClassVar[int]
    INFO_JSON_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    action: int
    key: str
    key_t_ns: int
    reward: float
    episode_return: float
    terminated: bool
    truncated: bool
    pose: Pose
    rt_ms: float
    state_hash: int
    observation_hash: int
    onset: bool
    action_vector: _containers.RepeatedScalarFieldContainer[float]
    success: bool
    info_json: str
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., action: _Optional[int] = ..., key: _Optional[str] = ..., key_t_ns: _Optional[int] = ..., reward: _Optional[float] = ..., episode_return: _Optional[float] = ..., terminated: bool = ..., truncated: bool = ..., pose: _Optional[_Union[Pose, _Mapping]] = ..., rt_ms: _Optional[float] = ..., state_hash: _Optional[int] = ..., observation_hash: _Optional[int] = ..., onset: bool = ..., action_vector: _Optional[_Iterable[float]] = ..., success: bool = ..., info_json: _Optional[str] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "png", "msgpack")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    PNG_FIELD_NUMBER: _ClassVar[int]
    MSGPACK_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    png: bytes
    msgpack: bytes
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., png: _Optional[bytes] = ..., msgpack: _Optional[bytes] = ...) -> None: ...

class FrameShown(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "submit_ns", "flip_ns", "picture_hash")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    PICTURE_HASH_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    submit_ns: int
    flip_ns: int
    picture_hash: int
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ..., picture_hash: _Optional[int] = ...) -> None: ...

class Sample(_message.Message):
    __slots__ = ("t_ns", "device", "values", "text")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    device: str
    values: _containers.RepeatedScalarFieldContainer[float]
    text: str
    def __init__(self, t_ns: _Optional[int] = ..., device: _Optional[str] = ..., values: _Optional[_Iterable[float]] = ..., text: _Optional[str] = ...) -> None: ...

class EpisodeEnd(_message.Message):
    __slots__ = ("t_ns", "episode", "outcome", "steps", "episode_return", "state_hash", "cause")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_RETURN_FIELD_NUMBER: _ClassVar[int]
    STATE_HASH_FIELD_NUMBER: _ClassVar[int]
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    outcome: str
    steps: int
    episode_return: float
    state_hash: int
    cause: str
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., outcome: _Optional[str] = ..., steps: _Optional[int] = ..., episode_return: _Optional[float] = ..., state_hash: _Optional[int] = ..., cause: _Optional[str] = ...) -> None: ...

class EpisodesSkipped(_message.Message):
    __slots__ = ("t_ns", "first", "count", "reason")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    first: int
    count: int
    reason: str
    def __init__(self, t_ns: _Optional[int] = ..., first: _Optional[int] = ..., count: _Optional[int] = ..., reason: _Optional[str] = ...) -> None: ...

class Scored(_message.Message):
    __slots__ = ("t_ns", "episode", "points", "total")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    points: float
    total: float
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., points: _Optional[float] = ..., total: _Optional[float] = ...) -> None: ...

class ClauseDone(_message.Message):
    __slots__ = ("t_ns", "episode", "step", "clause", "text")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    CLAUSE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    episode: int
    step: int
    clause: int
    text: str
    def __init__(self, t_ns: _Optional[int] = ..., episode: _Optional[int] = ..., step: _Optional[int] = ..., clause: _Optional[int] = ..., text: _Optional[str] = ...) -> None: ...

class PartStarted(_message.Message):
    __slots__ = ("t_ns", "part", "kind", "name")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    kind: str
    name: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., kind: _Optional[str] = ..., name: _Optional[str] = ...) -> None: ...

class PartEnded(_message.Message):
    __slots__ = ("t_ns", "part", "end", "next")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    end: str
    next: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., end: _Optional[str] = ..., next: _Optional[int] = ...) -> None: ...

class PageShown(_message.Message):
    __slots__ = ("t_ns", "part", "page", "pages", "submit_ns", "flip_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PAGE_FIELD_NUMBER: _ClassVar[int]
    PAGES_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    page: int
    pages: int
    submit_ns: int
    flip_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., page: _Optional[int] = ..., pages: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ...) -> None: ...

class TextTyped(_message.Message):
    __slots__ = ("t_ns", "text")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    text: str
    def __init__(self, t_ns: _Optional[int] = ..., text: _Optional[str] = ...) -> None: ...

class TextChanged(_message.Message):
    __slots__ = ("t_ns", "part", "item", "text", "changes", "keys", "waited_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    ITEM_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    CHANGES_FIELD_NUMBER: _ClassVar[int]
    KEYS_FIELD_NUMBER: _ClassVar[int]
    WAITED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    item: str
    text: str
    changes: _containers.RepeatedScalarFieldContainer[str]
    keys: int
    waited_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., item: _Optional[str] = ..., text: _Optional[str] = ..., changes: _Optional[_Iterable[str]] = ..., keys: _Optional[int] = ..., waited_ns: _Optional[int] = ...) -> None: ...

class PointerUsed(_message.Message):
    __slots__ = ("t_ns", "what", "x", "y", "target", "along", "waited_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    WHAT_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    ALONG_FIELD_NUMBER: _ClassVar[int]
    WAITED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    what: str
    x: float
    y: float
    target: str
    along: float
    waited_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., what: _Optional[str] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., target: _Optional[str] = ..., along: _Optional[float] = ..., waited_ns: _Optional[int] = ...) -> None: ...

class AxisMoved(_message.Message):
    __slots__ = ("t_ns", "axis", "value", "waited_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    AXIS_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    WAITED_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    axis: str
    value: float
    waited_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., axis: _Optional[str] = ..., value: _Optional[float] = ..., waited_ns: _Optional[int] = ...) -> None: ...

class AnswerChanged(_message.Message):
    __slots__ = ("t_ns", "part", "item", "value")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    ITEM_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    item: str
    value: str
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., item: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...

class Answered(_message.Message):
    __slots__ = ("t_ns", "part", "part_name", "item", "kind", "attempt", "value", "words", "shown_ns", "first_ns", "changes", "right")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    PART_NAME_FIELD_NUMBER: _ClassVar[int]
    ITEM_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    WORDS_FIELD_NUMBER: _ClassVar[int]
    SHOWN_NS_FIELD_NUMBER: _ClassVar[int]
    FIRST_NS_FIELD_NUMBER: _ClassVar[int]
    CHANGES_FIELD_NUMBER: _ClassVar[int]
    RIGHT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    part_name: str
    item: str
    kind: str
    attempt: int
    value: str
    words: str
    shown_ns: int
    first_ns: int
    changes: int
    right: bool
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., part_name: _Optional[str] = ..., item: _Optional[str] = ..., kind: _Optional[str] = ..., attempt: _Optional[int] = ..., value: _Optional[str] = ..., words: _Optional[str] = ..., shown_ns: _Optional[int] = ..., first_ns: _Optional[int] = ..., changes: _Optional[int] = ..., right: bool = ...) -> None: ...

class Linked(_message.Message):
    __slots__ = ("t_ns", "offset_ns", "error_ns", "rtt_ns", "least_rtt_ns", "drift_ppm")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    OFFSET_NS_FIELD_NUMBER: _ClassVar[int]
    ERROR_NS_FIELD_NUMBER: _ClassVar[int]
    RTT_NS_FIELD_NUMBER: _ClassVar[int]
    LEAST_RTT_NS_FIELD_NUMBER: _ClassVar[int]
    DRIFT_PPM_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    offset_ns: int
    error_ns: int
    rtt_ns: int
    least_rtt_ns: int
    drift_ppm: float
    def __init__(self, t_ns: _Optional[int] = ..., offset_ns: _Optional[int] = ..., error_ns: _Optional[int] = ..., rtt_ns: _Optional[int] = ..., least_rtt_ns: _Optional[int] = ..., drift_ppm: _Optional[float] = ...) -> None: ...

class TrialResolved(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "schedule_json", "start_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    SCHEDULE_JSON_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    schedule_json: str
    start_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., schedule_json: _Optional[str] = ..., start_ns: _Optional[int] = ...) -> None: ...

class StimuliShown(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "frame", "stimuli", "due_ns", "submit_ns", "flip_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    STIMULI_FIELD_NUMBER: _ClassVar[int]
    DUE_NS_FIELD_NUMBER: _ClassVar[int]
    SUBMIT_NS_FIELD_NUMBER: _ClassVar[int]
    FLIP_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    frame: int
    stimuli: _containers.RepeatedScalarFieldContainer[str]
    due_ns: int
    submit_ns: int
    flip_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., frame: _Optional[int] = ..., stimuli: _Optional[_Iterable[str]] = ..., due_ns: _Optional[int] = ..., submit_ns: _Optional[int] = ..., flip_ns: _Optional[int] = ...) -> None: ...

class ResponseTaken(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "number", "key", "action", "pressed_ns", "target_ns")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    PRESSED_NS_FIELD_NUMBER: _ClassVar[int]
    TARGET_NS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    number: int
    key: str
    action: int
    pressed_ns: int
    target_ns: int
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., number: _Optional[int] = ..., key: _Optional[str] = ..., action: _Optional[int] = ..., pressed_ns: _Optional[int] = ..., target_ns: _Optional[int] = ...) -> None: ...

class SoundPlayed(_message.Message):
    __slots__ = ("t_ns", "part", "episode", "sound", "cue", "due_ns", "scheduled_ns", "onset_ns", "uncertainty_ms")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    EPISODE_FIELD_NUMBER: _ClassVar[int]
    SOUND_FIELD_NUMBER: _ClassVar[int]
    CUE_FIELD_NUMBER: _ClassVar[int]
    DUE_NS_FIELD_NUMBER: _ClassVar[int]
    SCHEDULED_NS_FIELD_NUMBER: _ClassVar[int]
    ONSET_NS_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_MS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    part: int
    episode: int
    sound: str
    cue: int
    due_ns: int
    scheduled_ns: int
    onset_ns: int
    uncertainty_ms: float
    def __init__(self, t_ns: _Optional[int] = ..., part: _Optional[int] = ..., episode: _Optional[int] = ..., sound: _Optional[str] = ..., cue: _Optional[int] = ..., due_ns: _Optional[int] = ..., scheduled_ns: _Optional[int] = ..., onset_ns: _Optional[int] = ..., uncertainty_ms: _Optional[float] = ...) -> None: ...
