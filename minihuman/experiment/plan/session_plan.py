"""The plan of a session: participant, key maps, episodes and parts, resolved before the first key press."""

import re
from typing import Any, ClassVar, Literal

import msgspec

from minihuman.experiment.keys import list_pad_inputs
from minihuman.experiment.plan.designs import GroupAssignment, PlayedEpisode
from minihuman.worlds.contract import Palette
from minihuman.worlds.hashing import keep_files

ShownView = Literal["partial", "full", "text"]  # the picture on a participant's screen

SpareKeyPolicy = Literal["ignore", "distractor"]
KeyMapPolicy = Literal["new", "carry_over", "shown", "constant", "fixed"]
PacePolicy = Literal["on_key", "real_time"]
HoldPolicy = Literal["once", "repeat"]


class Participant(msgspec.Struct, frozen=True):
    """A participant, identified by a code and never by name."""

    id: str  # "sub-07"
    index: int  # order of enrolment, 0 for the first
    group: str  # "" until it is drawn
    stratum: str = ""  # the stratum from whose list the group was drawn; "" without strata
    slot: int | None = None  # the place in the allocation list; None if it equals the index
    assigned: GroupAssignment | None = None  # by an adaptive design; None if by the list or by hand

    @property
    def place(self) -> int:
        """Return the participant's index in the allocation list."""
        if self.slot is None:
            return self.index
        return self.slot


class KeyMap(msgspec.Struct, frozen=True):
    """The action of each physical key, the keys left over, and the seed of the draw."""

    keys: dict[str, str]  # physical key name (experiment/keys.py) -> action name, distractors included
    spare_keys: tuple[str, ...]  # the pool's other keys, which do nothing
    spare: SpareKeyPolicy  # how spare keys were dealt with: left without an action, or given the block's distractors
    seed: int

    def judge_idle_key(self, key: str) -> Literal["spare", "unmapped"]:
        """Return the verdict on a press of a key that has no action: whether the key is one of the spare keys."""
        if key in self.spare_keys:
            return "spare"
        return "unmapped"


class EpisodePlan(msgspec.Struct, frozen=True):
    """The plan of one episode, with every random choice made."""

    episode: int  # 0 for the session's first
    block: int  # index into the session's blocks
    block_name: str
    episode_in_block: int
    episodes_in_block: int
    world: str  # a Gymnasium id, "module:Id-v0" included
    options: dict[str, Any]  # keyword arguments of gymnasium.make
    seed: int  # the world's reset seed
    actions: tuple[str, ...]  # the action names that have a key
    key_map: KeyMap
    show_keys: bool  # whether the legend is on the screen
    pace: PacePolicy
    step_period_ms: float  # real_time only: the time between steps
    noop: str | None  # the action at a tick or deadline without a key; None for no step
    auto_repeat: bool  # on_key only: whether a held key makes further steps
    max_steps: int
    view: ShownView
    palette: Palette
    record_observations: bool = False  # whether the log contains observations beside their hashes
    onset_at_reset: bool = False  # real_time only: whether the first picture shows the stimulus
    hold: HoldPolicy = "once"  # real_time only: whether an action lasts while its key is held
    response_deadline_ms: float = 0.0  # on_key only: the time from a picture to the no-op; 0 for no deadline
    outcome_rule: str = ""  # what the episode's end means: see worlds/outcomes.py
    record_info: tuple[str, ...] = ()  # keys of the world's ``info`` that steps keep
    labels: dict[str, Any] = {}  # the stimulus's labels: cells of the table that are not passed to the world


class BlockText(msgspec.Struct, frozen=True):
    """The texts around a block; an empty text shows no screen."""

    instruction: str
    feedback: str  # after each episode; may contain {outcome} {reward} {steps} {episode} {episodes}
    rest: str  # after the block
    rest_s: float  # the shortest rest, seconds


class PartPlan(msgspec.Struct, frozen=True):
    """The base class of the plans of parts; the plans of a kind override what differs.

    ``host`` is "module:function"; the function builds the part's request handler from a `HostContext`.
    """

    host: ClassVar[str] = ""

    @property
    def asks_consent(self) -> bool:
        """Return whether the part asks for consent."""
        return False

    @property
    def sign_interval_s(self) -> float:
        """Return the longest interval between a page's signs of life in seconds; 0 if no partner waits for them."""
        return 0.0

    @property
    def has_text_entry(self) -> bool:
        """Return whether people type text during play, so that a page sends every key."""
        return False

    @property
    def closes_session(self) -> bool:
        """Return whether the part is the session's closing text."""
        return False

    @property
    def is_repeated_on_resume(self) -> bool:
        """Return whether a resumed session repeats the part."""
        return False

    @property
    def planned_episodes(self) -> range | None:
        """Return the indices of the part's episodes; None for a part that is not a block."""
        return None


class PlannedPart(msgspec.Struct, frozen=True):
    """One part of a session: its kind, its name, and the kind's own plan with every random choice made."""

    kind: str  # "play", "page", "questions", "keyboard_check", or another that is registered
    name: str  # in the protocol
    plan: Any  # the kind's frozen msgspec struct


class ResumeState(msgspec.Struct, frozen=True):
    """The state from which a resumed session continues, apart from the index of the next episode."""

    part: int = 0  # the part to begin with
    points: float = 0.0
    outcomes: tuple[str, ...] = ()  # of that part's episodes so far
    tries: dict[str, int] = {}  # number of attempts at questions, by the part's name
    history: tuple[PlayedEpisode, ...] | msgspec.UnsetType = msgspec.UNSET  # of that part's design; unset without one
    waited_ns: int | msgspec.UnsetType = msgspec.UNSET  # time in lobbies; unset without any
    stranded: bool | msgspec.UnsetType = msgspec.UNSET  # whether a team's block ended for lack of a partner


class BonusSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The rules by which a session earns a bonus in money."""

    per_point: float
    currency: str = ""
    base: float = 0.0
    most: float | None = None  # the bonus never exceeds it
    waiting_per_min: float | msgspec.UnsetType = msgspec.UNSET  # for each minute in a lobby, in addition
    base_pay: float | msgspec.UnsetType = msgspec.UNSET  # the least pay without a partner, or after a screening


class SessionPlan(msgspec.Struct, frozen=True):
    """The plan of a whole session: the result of ``expand_protocol()``, and the first thing logged."""

    study: str
    study_version: str
    protocol_toml: bytes  # the protocol file, byte for byte
    protocol_sha256: str
    participant: Participant
    session: int  # 1 for the first
    study_seed: int
    allocation_sha256: str | None  # hash of the up-front allocation list; None if the log has none
    overridden: bool  # whether participant or group was chosen by hand
    consent_text: str  # empty for no consent screen
    consent_sha256: str
    key_pool: tuple[str, ...]
    keyboard_check: bool
    texts: tuple[BlockText, ...]  # one per block
    closing_text: str
    episodes: tuple[EpisodePlan, ...]
    first_episode: int  # 0, or the episode with which a resumed session continues
    segment: int  # 1 for the first, one more after each resume
    parts: tuple[PlannedPart, ...] = ()  # in order; empty in logs of versions without parts
    words: dict[str, str] = {}  # the interface texts that differ from the English ones
    language: str = "en"
    standing: ResumeState = ResumeState()
    bonus: BonusSpec | None = None
    fonts: tuple[str, ...] = ()  # font files that are used before the built-in ones
    files: dict[str, bytes] = {}  # tables of stimuli and their images, from which the plan was made
    outcome_rules: int = 0  # version of the outcome rules; 0 for those of the last reward alone

    def __post_init__(self) -> None:
        keep_files(self.files.values())


def name_label_column(label: str) -> str:
    """Return the name of a label's column in tables, in letters, digits and underscores, which every format allows."""
    return f"label_{re.sub(r'[^a-zA-Z0-9]+', '_', label).strip('_')}"


def needs_gamepad(plan: SessionPlan) -> bool:
    """Return whether a session's keys include gamepad buttons, or its bindings gamepad axes."""
    return bool(list_pad_inputs([*plan.key_pool, *list_axes(plan)]))


def list_axes(plan: SessionPlan) -> list[str]:
    """Return the axes that move components of actions in a session's blocks, each once."""
    names: dict[str, None] = {}
    for part in plan.parts:
        bindings = getattr(part.plan, "bindings", None)
        if bindings:
            names.update(dict.fromkeys(bindings.axes))
    return list(names)
