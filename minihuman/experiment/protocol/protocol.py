"""Decode a protocol file strictly into a `Protocol`, and build its JSON schema. Knows no participants and no file
system.

The schema's tables are there field by field, with type, default, meaning and an example.
"""

import difflib
import hashlib
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any, Literal

import msgspec

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.activities.play.plan import ComputedBy, CriterionSpec, PointsSpec, ReadyPolicy
from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.trials.plan import StimuliSpec
from minihuman.errors import ProtocolError
from minihuman.experiment.keys import BUTTON_NAMES, KEY_NAMES_TEXT, PAD_AXES, RESERVED_KEYS
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
from minihuman.experiment.protocol import specs, strata
from minihuman.experiment.protocol.aliases import use_current_names
from minihuman.experiment.protocol.consistency import check_carried_key_maps, check_design, check_newer_design_rules
from minihuman.experiment.protocol.specs import (
    ActivitySpec,
    GroupOverrides,
    OrderSpec,
    PageSpec,
    QuestionnaireSpec,
    SessionSpec,
    apply_overrides,
    check_each,
    check_each_override,
)
from minihuman.experiment.protocol.validation_errors import (
    INTERNAL_FIELDS,
    FieldError,
    build_protocol_error,
    find_structural_errors,
    format_field_errors,
    select_errors,
)
from minihuman.worlds.contract import Palette

MAX_SEED = 2**63 - 1  # TOML's integers are 64-bit signed
MAX_ALLOCATED_BLOCKS = 1_000_000  # of all participants: the allocation list draws keys for each

_FORMAT = re.compile(r"[<>^=+\- ,]{0,3}\d{0,3}(\.\d{1,2})?[a-z%]?")  # of a number or word in a text


class StudySpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study as a whole."""

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
    """The keys that participants may find their actions on."""

    pool: tuple[str, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")  # physical keys, study/keys.py
    spare_keys: SpareKeyPolicy = "ignore"  # pool keys left over: nothing happens, or a block's distractors
    keyboard_check: bool = True  # each pool key is pressed once before data are taken


class GroupSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A condition: what its participants do, in order."""

    name: str
    blocks: tuple[str, ...] = ()  # names of blocks; consent, keyboard check and closing come by themselves
    parts: tuple[str, ...] = ()  # or names of pages, questions, blocks and orders, where there are no [[sessions]]
    allocation_ratio: int = 1  # how many participants for one of a group with ratio 1
    replace_parts: dict[str, str] = {}  # part -> the part this group has in its place; "" leaves it out


class BlockSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Episodes played in one world under one rule."""

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
    instructions: str = ""
    feedback: str | dict[Literal["goal", "timeout", "failure"], str] = ""  # after each episode, or by its outcome
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
    axes: dict[str, AxisBinding] = {}  # a gamepad's axis -> the component of the action that it moves
    spot: SpotBinding | None = None  # what a click in the picture does
    design: DesignSpec | None = None  # chooses each episode's options or layout, or ends the block, from those before
    group_overrides: GroupOverrides = {}


class ExclusionSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rule, fixed before the data are seen, for what the report leaves out."""

    reason: str
    level: Literal["episode", "participant"]
    measure: str  # a column of the report's episode or participant table
    below: float | None = None  # leaves out values less than this
    above: float | None = None  # leaves out values greater than this


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A study's protocol. ``decode`` is the only way to make one from a file."""

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
    allocation: strata.AllocationSpec = strata.AllocationSpec()
    devices: tuple[specs.DeviceSpec, ...] = ()
    web: specs.WebSpec = specs.WebSpec()
    model: specs.ModelSpec = specs.ModelSpec()
    toml: bytes = b""  # the file itself, byte for byte; not a field of the file

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, hexadecimal."""
        return hashlib.sha256(self.toml).hexdigest()

    def block(self, name: str) -> BlockSpec:
        """The block of that name."""
        return next(block for block in self.blocks if block.name == name)

    def block_for(self, name: str, group: str) -> BlockSpec:
        """The block of that name as a group has it."""
        return apply_overrides(self.block(name), group)

    def page_for(self, name: str, group: str) -> PageSpec | None:
        """The page of that name as a group has it; None if there is none."""
        return next((apply_overrides(page, group) for page in self.pages if page.name == name), None)

    @property
    def lists_parts(self) -> bool:
        """Whether the file lists parts itself, in sessions or in groups."""
        return bool(self.sessions) or any(group.parts for group in self.groups)

    def group(self, name: str) -> GroupSpec:
        """The group of that name.

        Raises:
            ProtocolError: if there is none.
        """
        for group in self.groups:
            if group.name == name:
                return group
        names = ", ".join(group.name for group in self.groups)
        raise ProtocolError(f"study {self.study.name!r} has no group {name!r}; its groups are {names}")


_Rules = Callable[[Protocol], Iterable[FieldError]]


def decode_protocol(toml: bytes, source: str = "protocol", files: Mapping[str, bytes] | None = None) -> Protocol:
    """Read a protocol file's bytes; ``source`` names the file in errors, ``files`` are those it names beside itself.

    Raises:
        ProtocolError: of every mistake, a line each with file, line, path, value and the way out.
    """
    return _decode(toml, source, files or {}, (_check_values, _check_newer_rules))


def decode_logged_protocol(toml: bytes, source: str = "the protocol in a log") -> Protocol:
    """Read the protocol that a session was played by; it need not keep rules that came after it.

    Raises:
        ProtocolError: as ``decode``.
    """
    return _decode(toml, source, {}, (_check_values,))


def _decode(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    try:
        return _decoded(toml, source, files, rules)
    except ProtocolError:
        raise
    except Exception as error:  # a file can be written to make a parser raise anything: nesting, huge numbers
        said = str(error).splitlines()[0] if str(error) else ""
        raise ProtocolError(f"{source}: cannot be read: {type(error).__name__}: {said[:200]}") from error


def _decoded(toml: bytes, source: str, files: Mapping[str, bytes], rules: Sequence[_Rules]) -> Protocol:
    try:
        text = toml.decode("utf-8-sig")  # an editor may begin the file with a byte-order mark
        tree = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ProtocolError(f"{source}: byte {error.start} is not valid UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"{source}: this is not valid TOML: {error}") from None
    names = use_current_names(tree)
    wrong = [*names.conflicts, *find_structural_errors(names.tree, Protocol)]
    if not wrong:
        protocol = msgspec.convert(names.tree, Protocol)
        wrong = [complaint for rule in rules for complaint in rule(protocol)]
    written = [(names.written_path(path), what) for path, what in wrong]
    if mistakes := build_protocol_error(written, source=source, text=text, tree=tree):
        raise mistakes
    return msgspec.structs.replace(protocol, toml=toml, files=dict(files))


def _check_values(protocol: Protocol) -> list[FieldError]:
    """Every (path, complaint) about values that have the right type but make no study."""
    return [
        *_check_study(protocol.study),
        *_check_keys(protocol.keys),
        *_check_groups(protocol),
        *check_each("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
        *(
            (f"$.blocks[{number}].{field}", complaint)
            for number, block in enumerate(protocol.blocks)
            for field, complaint in _check_unused_block_fields(block, protocol.keys)
        ),
        *check_design(protocol),
        *specs.check_about(protocol.about),
        *specs.check_analysis(
            protocol.analysis,
            tuple(block.name for block in protocol.blocks),
            practice=tuple(block.name for block in protocol.blocks if not block.analysed),
        ),
        *strata.check_allocation(protocol),
        *specs.check_devices(protocol.devices),
        *specs.check_web(protocol.web),
        *specs.check_model(protocol.model),
        *(
            (f"$.exclusions[{number}]", "has neither below nor above; give one of them")
            for number, rule in enumerate(protocol.exclusions)
            if rule.below is None and rule.above is None
        ),
    ]


def _check_newer_rules(protocol: Protocol) -> list[FieldError]:
    """The same, by rules without which studies were run before there were any."""
    return [
        *check_each_override("blocks", protocol.blocks, lambda block: _check_block(block, protocol)),
        *check_carried_key_maps(protocol),
        *_check_allocation_size(protocol),
        *check_newer_design_rules(protocol),
    ]


def _check_study(study: StudySpec) -> list[FieldError]:
    return select_errors(
        [
            (not specs.NAME_PATTERN.fullmatch(study.name), "$.study.name", f"is {study.name!r}; {specs.NAME_RULE}"),
            (not 0 <= study.seed <= MAX_SEED, "$.study.seed", f"is {study.seed}; a seed is 0 or more"),
            (
                not 1 <= study.participants <= 100_000,
                "$.study.participants",
                f"is {study.participants}; use 1 to 100000",
            ),
            (
                not 0 <= study.min_rest_s <= 86_400,
                "$.study.min_rest_s",
                f"is {study.min_rest_s}; a rest is 0 to 86400 s",
            ),
        ]
    )


def _check_allocation_size(protocol: Protocol) -> list[FieldError]:
    count, blocks = (
        protocol.study.participants,
        max(len(protocol.blocks), *(len(one.blocks) for one in protocol.groups)),
    )
    if count * blocks <= MAX_ALLOCATED_BLOCKS:
        return []
    return [("$.study.participants", f"is {count} with {blocks} blocks each; ask for {MAX_ALLOCATED_BLOCKS // blocks}")]


def _check_keys(keys: KeysSpec) -> list[FieldError]:
    found = []
    for number, key in enumerate(keys.pool):
        if key not in BUTTON_NAMES:
            close = difflib.get_close_matches(key, BUTTON_NAMES, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"keys are called {KEY_NAMES_TEXT}"
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which is not a key; {hint}"))
        elif key in RESERVED_KEYS:
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which the session itself uses; choose another"))
        elif key in keys.pool[:number]:
            found.append((f"$.keys.pool[{number}]", f"is {key!r} again; name each key once"))
    return found


def _check_groups(protocol: Protocol) -> list[FieldError]:
    if not protocol.groups:
        return [("$.groups", "is empty; a study has one group or more")]
    if not protocol.blocks and not protocol.lists_parts:
        return [("$.blocks", "is empty; a study has one block or more, or parts that are not played")]
    found = [*specs.check_names("groups", protocol.groups), *specs.check_names("blocks", protocol.blocks)]
    names = [block.name for block in protocol.blocks]
    for number, group in enumerate(protocol.groups):
        if not group.blocks and not protocol.lists_parts:
            found.append((f"$.groups[{number}].blocks", "is empty; a group plays one block or more"))
        for place, name in enumerate(group.blocks):
            if name not in names:
                path = f"$.groups[{number}].blocks[{place}]"
                found.append((path, f"is {name!r}, which is not a block; blocks: {', '.join(names)}"))
    return found


def _check_block(block: BlockSpec, protocol: Protocol) -> list[FieldError]:
    pool = len(protocol.keys.pool)
    twice = [name for name, count in Counter(block.actions + block.distractors).items() if count > 1]
    deals_out = protocol.keys.spare_keys == "distractor"
    stimuli = block.stimuli
    found = select_errors(
        [
            (not block.world, "world", "is empty; `minihuman worlds` lists ours"),
            (not 1 <= block.episodes <= 10_000, "episodes", f"is {block.episodes}; an episode count is 1 to 10000"),
            (not 1 <= block.max_steps <= 1_000_000, "max_steps", f"is {block.max_steps}; use 1 to 1000000"),
            (not block.actions, "actions", "is empty; name the actions that get a key"),
            (twice, "actions", f"and distractors name {', '.join(map(repr, twice))} twice; name each once"),
            (
                len(block.actions) > pool,
                "actions",
                f"has {len(block.actions)} for {pool} keys in $.keys.pool; add keys",
            ),
            (
                deals_out and not block.distractors,
                "distractors",
                "is empty, but $.keys.spare_keys is 'distractor'; name the actions to deal out",
            ),
            (
                block.pace == "real_time" and not 5 <= block.step_period_ms <= 60_000,
                "step_period_ms",
                f"is {block.step_period_ms}; real_time needs 5 to 60000 ms",
            ),
            (
                not 0 <= block.response_deadline_ms <= 3_600_000,
                "response_deadline_ms",
                f"is {block.response_deadline_ms:g}; use 0 to 3600000 ms",
            ),
            (
                stimuli is not None and bool(stimuli.file) == bool(stimuli.rows),
                "stimuli",
                "needs a file or rows, and not both",
            ),
        ]
    )
    if isinstance(block.seeds, tuple):
        if len(block.seeds) != block.episodes:
            found.append(("seeds", f"has {len(block.seeds)} seeds for {block.episodes} episodes; give one an episode"))
        if any(not 0 <= seed <= MAX_SEED for seed in block.seeds):
            found.append(("seeds", "has a negative seed; a seed is 0 or more"))
    for text in [block.feedback] if isinstance(block.feedback, str) else block.feedback.values():
        try:
            _check_placeholders(text)
            text.format(outcome="", reward=0.0, steps=0, episode=0, episodes=0, points=0.0, total=0.0)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            fields = "outcome, reward, steps, episode, episodes, points, total"
            found.append(("feedback", f"has a bad placeholder ({error}); use {fields}"))
    return found


def _check_unused_block_fields(block: BlockSpec, keys: KeysSpec) -> list[FieldError]:
    """What is given and does nothing."""
    on_key, real_time = block.pace == "on_key", block.pace == "real_time"
    deadline = block.response_deadline_ms
    kind = f"is for blocks that are played, not for kind {block.kind!r}; remove it"
    return select_errors(
        [
            (
                keys.spare_keys == "ignore" and block.distractors,
                "distractors",
                "has actions, but $.keys.spare_keys is 'ignore'; set it to 'distractor'",
            ),
            (
                on_key and (block.step_period_ms or (block.noop_action and not deadline)),
                "pace",
                "is 'on_key', which has no step_period_ms and no noop_action; remove them or use 'real_time'",
            ),
            (
                on_key and block.hold != "once",
                "hold",
                "is for 'real_time'; in 'on_key' each press is a step: remove it, or see auto_repeat",
            ),
            (
                real_time and deadline,
                "response_deadline_ms",
                "is for 'on_key'; in 'real_time' a tick decides: remove it",
            ),
            (
                deadline and block.noop_action is None,
                "response_deadline_ms",
                "needs noop_action, which is done at the deadline; name one",
            ),
            (
                on_key and block.stimulus_onset != "world",
                "stimulus_onset",
                "is for 'real_time'; in 'on_key' every picture is an onset; remove it",
            ),
            (block.axes and block.kind not in ("play", "trials"), "axes", kind),
            (block.spot and block.kind not in ("play", "trials"), "spot", kind),
            (
                block.axes and block.hold != "repeat",
                "axes",
                "are read at each tick; use pace = 'real_time' and hold = 'repeat'",
            ),
            (
                block.spot and block.hold == "repeat",
                "spot",
                "is an action of its own, but held keys combine; use hold = 'once'",
            ),
            *(
                (axis not in PAD_AXES, "axes", f"has {axis!r}, which is no axis; axes: {', '.join(PAD_AXES)}")
                for axis in block.axes
            ),
            (real_time and block.auto_repeat, "auto_repeat", "is for 'on_key'; in 'real_time' a tick decides"),
        ]
    )


def _check_placeholders(text: str) -> None:
    """Refuse placeholders that are more than a field and a short format: they could ask for a text of any size.

    Raises:
        ValueError: if there is one.
    """
    for _, field, format_spec, conversion in Formatter().parse(text):
        if field is not None and (not field.isidentifier() or conversion or not _FORMAT.fullmatch(format_spec or "")):
            raise ValueError(f"{{{field}{':' if format_spec else ''}{format_spec}}}")


def list_old_names(protocol: Protocol, source: str) -> list[str]:
    """A line per old name of a field or value that a protocol's file uses, with its name now; none in a new file."""
    text = protocol.toml.decode("utf-8-sig")
    tree = tomllib.loads(text)
    return format_field_errors(use_current_names(tree).renamed, source=source, text=text, tree=tree)


_TYPES = {"string": "string", "integer": "integer", "number": "number", "boolean": "true or false", "object": "table"}
_PLURALS = {"string": "strings", "integer": "integers", "number": "numbers", "table": "tables"}


@dataclass(frozen=True, slots=True)
class ProtocolField:
    """A field of a table of a protocol; the texts are Markdown."""

    name: str
    type: str  # "list of strings"
    default: str  # as TOML; "required" or "absent" where there is none
    meaning: str
    example: str  # a value, as TOML


def build_json_schema() -> dict[str, Any]:
    """Build the schema (draft 2020-12) of what ``decode_protocol`` takes, with each field's meaning and an example."""
    schema = msgspec.json.schema(Protocol)
    for name in INTERNAL_FIELDS:
        schema["$defs"]["Protocol"]["properties"].pop(name, None)
    for table, definition, _ in _walk_tables(schema):
        for name, (meaning, example) in _read_fields().get(table, {}).items():
            definition["properties"][name] |= {
                "description": meaning,
                "examples": [tomllib.loads(f"value = {example}")["value"]],
            }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "minihuman protocol", **schema}


def list_protocol_tables() -> dict[str, tuple[str, list[ProtocolField]]]:
    """List the tables of a protocol by path ("blocks.agent"), each with its TOML heading and its fields.

    Raises:
        KeyError: if a field has no meaning and example.
    """
    schema = msgspec.json.schema(Protocol)
    return {
        table: (
            f"[[{table}]]" if repeated else f"[{table}]",
            [
                ProtocolField(
                    name,
                    _describe_type(field, schema),
                    _describe_default(field) if name not in definition.get("required", ()) else "required",
                    *_read_fields()[table][name],
                )
                for name, field in definition["properties"].items()
            ],
        )
        for table, definition, repeated in _walk_tables(schema)
    }


@cache
def _read_fields() -> dict[str, dict[str, tuple[str, str]]]:
    return tomllib.loads((files(__package__) / "fields.toml").read_text(encoding="utf-8"))


def _walk_tables(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield each table's path, its definition, and whether the file may have it several times."""
    waiting = [("", "Protocol", False)]
    while waiting:
        path, name, repeated = waiting.pop(0)
        definition = schema["$defs"][name]
        if path:
            yield path, definition, repeated
        inner = []
        for field, what in definition["properties"].items():
            if (found := _find_definition(what)) is not None:
                inner.append((f"{path}.{field}".lstrip("."), found, "items" in what))
        waiting = [*inner, *waiting]


def _find_definition(field: dict[str, Any]) -> str | None:
    for one in (field, field.get("items") or {}, *field.get("anyOf", ())):
        if "$ref" in one:
            return str(one["$ref"]).rpartition("/")[2]
    return None


def _describe_type(field: dict[str, Any], schema: dict[str, Any]) -> str:
    if "$ref" in field:
        return "table"
    if "enum" in field:
        *others, last = (f'`"{one}"`' for one in field["enum"])
        return f"{', '.join(others)} or {last}" if others else last
    if "anyOf" in field:
        described = (_describe_type(one, schema) for one in field["anyOf"] if one.get("type") != "null")
        return " or ".join(dict.fromkeys(described))
    if "prefixItems" in field:
        return "two integers"
    if field.get("type") == "array":
        each = _describe_type(field["items"], schema).split(" or ")
        return f"list of {' or '.join(_PLURALS.get(one, one.replace('list ', 'lists ')) for one in each)}"
    return _TYPES[field["type"]]


def _describe_default(field: dict[str, Any]) -> str:
    default = field.get("default")
    if default is None or "$ref" in field:
        return "absent"
    return f"`{msgspec.json.encode(default).decode()}`"
