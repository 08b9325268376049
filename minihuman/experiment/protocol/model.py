"""A protocol as typed values: study, keys, groups and blocks. The module `protocol` validates them."""

import hashlib
from typing import Any, Literal

import msgspec

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.activities.play.plan import ComputedBy, CriterionSpec, PointsSpec, ReadyPolicy
from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.trials.plan import StimuliSpec, TimelineSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.bindings import AxisBinding, SpotBinding
from minihuman.experiment.plan.designs import DesignSpec
from minihuman.experiment.plan.session_plan import (
    BonusSpec,
    HoldPolicy,
    KeyMapPolicy,
    PacePolicy,
    ShownView,
    SpareKeyPolicy,
)
from minihuman.experiment.protocol import specs
from minihuman.experiment.protocol.design_spec import StudyDesignSpec
from minihuman.experiment.protocol.specs import (
    ActivitySpec,
    GroupOverrides,
    OrderSpec,
    PageSpec,
    QuestionnaireSpec,
    SessionSpec,
    apply_overrides,
)
from minihuman.worlds.contract import Palette

MAX_SEED = 2**63 - 1  # TOML's integers are 64-bit signed


class StudySpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of the study as a whole."""

    name: str  # lower-case letters, digits, "-" and "_": it names a folder
    version: str
    seed: int  # every random choice of the study derives from it
    participants: int = 100  # length of the allocation list made up front
    consent: str = ""  # shown first; agreement is logged with this text's SHA-256; "" shows nothing
    closing: str | None = None  # the last screen; if absent, thanks in the study's language
    min_rest_s: float = 0.0  # the shortest break between blocks, seconds
    language: str = "en"  # of the interface texts: en de fr es zh ja ar he, or another with all texts in [words]
    theme: Literal["dark", "light"] = "dark"  # of every screen
    logo: str = ""  # a PNG file beside the protocol, shown above the consent and the closing text
    fonts: tuple[str, ...] = ()  # font files on the machine that runs the study, used before the built-in ones


class KeysSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The keys to which a participant's actions can be assigned."""

    pool: tuple[str, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")  # physical keys, experiment/keys.py
    spare_keys: SpareKeyPolicy = "ignore"  # whether spare keys have no action, or a block's distractors
    keyboard_check: bool = True  # whether each pool key is pressed once before the first block


class GroupSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A group of participants: what they do, in order."""

    name: str
    blocks: tuple[str, ...] = ()  # names of blocks; consent, keyboard check and closing are added
    parts: tuple[str, ...] = ()  # or names of pages, questions, blocks and orders, without [[sessions]]
    allocation_ratio: int = 1  # number of participants for each one in a group with ratio 1
    replace_parts: dict[str, str] = {}  # part -> the part that replaces it in this group; "" leaves it out


class BlockSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Episodes played in one world under the same rules."""

    name: str
    world: str  # "minihuman/MiniGrid-FourRooms-v0", "module:Id-v0"
    episodes: int
    actions: tuple[str, ...]  # the world's actions that get a key; carried key maps match them by position
    max_steps: int  # number of steps after which an episode is a timeout
    options: dict[str, Any] = {}  # keyword arguments of gymnasium.make
    seeds: Literal["new", "same"] | tuple[int, ...] = "new"
    key_map: KeyMapPolicy = "new"
    distractors: tuple[str, ...] = ()  # actions dealt to spare keys when keys.spare_keys = "distractor"
    pace: PacePolicy = "on_key"
    step_period_ms: float = 0.0  # real_time: the time between steps
    noop_action: str | None = None  # real_time: the action of a tick without a key; if absent, such a tick is no step
    hold: HoldPolicy = "once"  # real_time: "repeat" lasts while the key is held, and held keys combine
    response_deadline_ms: float = 0.0  # on_key: the time from a picture to noop_action; 0 for no deadline
    stimulus_onset: Literal["world", "reset"] = "world"  # real_time: a step's info["onset"], or the first picture
    auto_repeat: bool = False  # on_key: whether a held key makes further steps
    view: ShownView = "partial"
    palette: Palette = "classic"
    motion_ms: float = 0.0  # the time in which the view moves to a step's picture; 0 to change it at once
    record_observations: bool = False  # whether the log contains observations beside their hashes
    record_info: tuple[str, ...] = ()  # keys of the world's info that become columns of steps
    success: str | None = None  # the rule for success: "info:KEY", "return >= 195", "reward > 0", "terminated", "none"
    success_at: Literal["end", "any"] = "end"  # whether the last step decides, or any step is enough
    instructions: str = ""
    feedback: str | dict[Literal["goal", "timeout", "failure", "ended"], str] = (
        ""  # after each episode, or by its outcome
    )
    feedback_ms: float = 0.0  # the duration of the feedback; 0 until Enter
    rest_text: str = ""  # shown after the block if another follows
    fixed_keys: dict[str, str] = {}  # key_map = "fixed": physical key -> action
    show_keys: bool = False  # whether the keys are on the screen, as with key_map = "shown"
    title: str = ""  # above the instructions; if absent, "Part 1 of 2"
    mission: str = ""  # shown instead of the world's mission
    stop_criterion: CriterionSpec | None = None  # the criterion that ends the block
    max_episode_s: float = 0.0  # an episode's longest playing time, seconds; 0 for no limit
    max_block_s: float = 0.0  # the block's longest playing time, seconds; 0 for no limit
    ready: ReadyPolicy = "each"  # which episodes wait for Enter at "Ready?": each, the block's first, none
    inter_trial_interval_ms: float | tuple[float, float] = (
        0.0  # duration of an empty screen before each episode, or the range from which it is drawn
    )
    fixation_ms: float = 0.0  # duration of the fixation cross after it
    final_frame_ms: float = 500.0  # for which the last picture stays
    show_outcome: bool = False  # whether the last picture shows the outcome by a mark and a colour
    points: PointsSpec | None = None
    show_points: bool = False  # whether the total so far is on the screen
    analysed: bool = True  # false for practice, which comparisons and participants' measures leave out
    computed: ComputedBy | None = None  # who makes steps and draws in a browser; if absent, the page if it can
    kind: str = "play"  # or another kind of block: "takeover", "rating", ...
    agent: AgentPlan | None = None  # the agent, if the kind has one
    team: TeamPlan | None = None  # the team's seats, if the kind is "team"
    stimuli: StimuliSpec | None = None  # a table of the world's options, one row per trial
    timeline: TimelineSpec | None = None  # the stimuli of each trial, with their onsets and durations
    axes: dict[
        str, AxisBinding
    ] = {}  # an axis of a gamepad, mouse or touch stick -> the component of the action that it moves
    spot: SpotBinding | None = None  # the effect of a click in the picture
    design: DesignSpec | None = None  # an adaptive design, which chooses each episode or ends the block
    group_overrides: GroupOverrides = {}


class ExclusionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rule, fixed before the data are seen, that excludes data from the report."""

    reason: str
    level: Literal["episode", "participant"]
    measure: str  # a column of the report's episode or participant table, "label:NAME", or "answer:QUESTIONS.ITEM"
    below: float | None = None  # excludes values less than this
    above: float | None = None  # excludes values greater than this
    where: dict[str, str | int | float | bool] = {}  # only trials whose labels have these levels
    is_one_of: tuple[str | int | float, ...] = ()  # excludes participants who gave one of these answers
    is_none_of: tuple[str | int | float, ...] = ()  # excludes participants who gave any other answer
    is_missing: bool = False  # excludes participants who were asked and gave no answer

    @property
    def measured_label(self) -> str:
        """Return the label of trials that the rule measures; "" for another measure."""
        if self.measure.startswith("label:"):
            return self.measure.removeprefix("label:")
        return ""

    @property
    def question(self) -> str:
        """Return the question whose answer is compared, as QUESTIONS.ITEM; "" for another measure."""
        if self.measure.startswith("answer:"):
            return self.measure.removeprefix("answer:")
        return ""


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A study's protocol. `decode_protocol` makes one from a file."""

    study: StudySpec
    groups: tuple[GroupSpec, ...]
    blocks: tuple[BlockSpec, ...] = ()
    keys: KeysSpec = KeysSpec()
    exclusions: tuple[ExclusionSpec, ...] = ()
    pages: tuple[PageSpec, ...] = ()
    questions: tuple[QuestionnaireSpec, ...] = ()
    activities: tuple[ActivitySpec, ...] = ()
    orders: tuple[OrderSpec, ...] = ()
    sessions: tuple[SessionSpec, ...] = ()
    words: dict[str, Any] = {}  # replacements of interface texts, in tables as in minihuman/experiment/words
    bonus: BonusSpec | None = None
    files: dict[str, bytes] = {}  # contents of the files that the protocol names; not a field of the file
    about: specs.AboutSpec = specs.AboutSpec()
    analysis: specs.AnalysisSpec = specs.AnalysisSpec()
    design: StudyDesignSpec = StudyDesignSpec()
    allocation: specs.AllocationSpec = specs.AllocationSpec()
    devices: tuple[specs.DeviceSpec, ...] = ()
    web: specs.WebSpec = specs.WebSpec()
    model: specs.ModelSpec = specs.ModelSpec()
    toml: bytes = b""  # the file itself, byte for byte; not a field of the file

    @property
    def sha256(self) -> str:
        """Return the SHA-256 of the file in hexadecimal."""
        return hashlib.sha256(self.toml).hexdigest()

    def block(self, name: str) -> BlockSpec:
        """Return the block of a given name, which must exist."""
        return next(block for block in self.blocks if block.name == name)

    def block_for(self, name: str, group: str) -> BlockSpec:
        """Return the block of a given name, which must exist, with a group's overrides."""
        return apply_overrides(self.block(name), group)

    def page_for(self, name: str, group: str) -> PageSpec | None:
        """Return the page of a given name with a group's overrides; None if there is none."""
        return next((apply_overrides(page, group) for page in self.pages if page.name == name), None)

    @property
    def lists_parts(self) -> bool:
        """Return whether the file itself lists the parts of sessions or groups."""
        return bool(self.sessions) or any(group.parts for group in self.groups)

    def group(self, name: str) -> GroupSpec:
        """Return the group of a given name.

        Raises:
            ProtocolError: if there is no such group.
        """
        for group in self.groups:
            if group.name == name:
                return group
        names = ", ".join(group.name for group in self.groups)
        raise ProtocolError(f"study {self.study.name!r} has no group {name!r}; its groups are {names}")
