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
    closing: str | None = None  # the last screen; absent: thanks in the study's language
    min_rest_s: float = 0.0  # the shortest break between blocks, seconds
    language: str = "en"  # of the interface's words: en de fr es zh ja ar he, or another with all its [words]
    theme: Literal["dark", "light"] = "dark"  # of every screen
    logo: str = ""  # a PNG file beside the protocol: above the consent and the last words
    fonts: tuple[str, ...] = ()  # files of faces installed where the study runs, asked for a character before ours


class KeysSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The keys to which a participant's actions can be assigned."""

    pool: tuple[str, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")  # physical keys, study/keys.py
    spare_keys: SpareKeyPolicy = "ignore"  # pool keys left over: nothing happens, or a block's distractors
    keyboard_check: bool = True  # each pool key is pressed once before data are taken


class GroupSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A group of participants: what they do, in order."""

    name: str
    blocks: tuple[str, ...] = ()  # names of blocks; consent, keyboard check and closing come by themselves
    parts: tuple[str, ...] = ()  # or names of pages, questions, blocks and orders, where there are no [[sessions]]
    allocation_ratio: int = 1  # how many participants for one of a group with ratio 1
    replace_parts: dict[str, str] = {}  # part -> the part this group has in its place; "" leaves it out


class BlockSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Episodes played in one world under the same rules."""

    name: str
    world: str  # "minihuman/MiniGrid-FourRooms-v0", "module:Id-v0"
    episodes: int
    actions: tuple[str, ...]  # the world's actions that get a key; carried maps go by position in this list
    max_steps: int  # an episode is a timeout after so many
    options: dict[str, Any] = {}  # keyword arguments of gymnasium.make
    seeds: Literal["new", "same"] | tuple[int, ...] = "new"
    key_map: KeyMapPolicy = "new"
    distractors: tuple[str, ...] = ()  # actions dealt to spare keys when keys.spare_keys = "distractor"
    pace: PacePolicy = "on_key"
    step_period_ms: float = 0.0  # real_time: the time between steps
    noop_action: str | None = None  # real_time: the action of a tick without a key; absent: such a tick is no step
    hold: HoldPolicy = "once"  # real_time: "repeat" lasts while the key is held, and held keys combine
    response_deadline_ms: float = 0.0  # on_key: noop_action is done so long after a picture without a key; 0: never
    stimulus_onset: Literal["world", "reset"] = "world"  # real_time: a step's info["onset"], or the first picture
    auto_repeat: bool = False  # on_key: holding a key steps again
    view: ShownView = "partial"
    palette: Palette = "classic"
    motion_ms: float = 0.0  # the view moves from one step's picture to the next for so long; 0: it changes at once
    record_observations: bool = False  # the log holds what was observed, beside its hash
    record_info: tuple[str, ...] = ()  # keys of the world's info that become columns of steps
    success: str | None = None  # what success is: "info:KEY", "return >= 195", "reward > 0", "terminated", "none"
    success_at: Literal["end", "any"] = "end"  # whether the last step decides, or any step is enough
    instructions: str = ""
    feedback: str | dict[Literal["goal", "timeout", "failure", "ended"], str] = (
        ""  # after each episode, or by its outcome
    )
    feedback_ms: float = 0.0  # the feedback goes by itself after so long; 0: by Enter
    rest_text: str = ""  # after the block, when another follows
    fixed_keys: dict[str, str] = {}  # key_map = "fixed": physical key -> action
    show_keys: bool = False  # the keys are on the screen, as with key_map = "shown"
    title: str = ""  # above the instruction; absent: "Part 1 of 2"
    mission: str = ""  # what is to be done, instead of the world's words
    stop_criterion: CriterionSpec | None = None  # the block is over as soon as it is met
    max_episode_s: float = 0.0  # an episode's longest playing time, seconds; 0: none
    max_block_s: float = 0.0  # the block's
    ready: ReadyPolicy = "each"  # which episodes wait for Enter at "Ready?": each, the block's first, none
    inter_trial_interval_ms: float | tuple[float, float] = (
        0.0  # an empty screen before each episode; drawn from a range
    )
    fixation_ms: float = 0.0  # then a cross
    final_frame_ms: float = 500.0  # the last picture stays
    show_outcome: bool = False  # and carries a mark and a colour for the outcome
    points: PointsSpec | None = None
    show_points: bool = False  # the running total is on the screen
    analysed: bool = True  # false for practice, which no comparison and no participant's value includes
    computed: ComputedBy | None = None  # who steps first and draws in a browser; absent: the page where it can
    kind: str = "play"  # or another kind of block: "takeover", "rating", ...
    agent: AgentPlan | None = None  # that plays, where the kind has one
    team: TeamPlan | None = None  # who sits in which body, where the kind is "team"
    stimuli: StimuliSpec | None = None  # a table of options of the world, one row an episode
    timeline: TimelineSpec | None = None  # the time course of each trial: what is shown from when to when
    axes: dict[
        str, AxisBinding
    ] = {}  # an axis of a gamepad, mouse or touch stick -> the component of the action that it moves
    spot: SpotBinding | None = None  # what a click in the picture does
    design: DesignSpec | None = None  # chooses each episode's options or layout, or ends the block, from those before
    group_overrides: GroupOverrides = {}


class ExclusionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rule, fixed before the data are seen, that excludes data from the report."""

    reason: str
    level: Literal["episode", "participant"]
    measure: str  # a column of the report's episode or participant table, "label:NAME", or "answer:QUESTIONS.ITEM"
    below: float | None = None  # leaves out values less than this
    above: float | None = None  # leaves out values greater than this
    where: dict[str, str | int | float | bool] = {}  # only trials whose labels have these levels
    is_one_of: tuple[str | int | float, ...] = ()  # leaves out who gave one of these answers
    is_none_of: tuple[str | int | float, ...] = ()  # leaves out who gave none of these answers, but another
    is_missing: bool = False  # leaves out who was asked and gave no answer

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
    words: dict[str, Any] = {}  # the interface's words in other words, by table as in minihuman/experiment/words
    bonus: BonusSpec | None = None
    files: dict[str, bytes] = {}  # what the file names beside itself; not a field of the file
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
        """Return the block of a given name."""
        return next(block for block in self.blocks if block.name == name)

    def block_for(self, name: str, group: str) -> BlockSpec:
        """Return the block of a given name with a group's overrides."""
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
