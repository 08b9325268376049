"""The protocol: a study as a TOML file says it, decoded strictly. Knows nothing of participants or files."""

import difflib
import hashlib
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from string import Formatter
from typing import Any, Literal

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study import about as facts
from minihuman.study import analysis as judged
from minihuman.study import devices as apparatus
from minihuman.study import online as browsers
from minihuman.study import strata as alike
from minihuman.study.activities.agent_plan import AgentPlan
from minihuman.study.activities.play_plan import Criterion, Points
from minihuman.study.carried import carry_complaints
from minihuman.study.design import (
    Complaint,
    Day,
    Order,
    Other,
    Override,
    Questionnaire,
    Text,
    as_for,
    of_each,
    of_each_group,
)
from minihuman.study.design_complaints import design_complaints, later_design_complaints
from minihuman.study.keys import KEY_NAMES, KEYS_IN_WORDS, RESERVED
from minihuman.study.mistakes import structural, told
from minihuman.study.plan import Bonus, KeyMapPolicy, PacePolicy, Spare
from minihuman.worlds.contract import Palette, View

MAX_SEED = 2**63 - 1  # TOML's integers are 64-bit signed

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")
_FORMAT = re.compile(r"[<>^=+\- ,]{0,3}\d{0,3}(\.\d{1,2})?[a-z%]?")  # of a number or word in a text


class Study(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study as a whole."""

    name: str  # lower-case letters, digits, "-" and "_": it names a folder
    version: str
    seed: int  # every random choice of the study derives from it
    participants: int = 100  # length of the allocation list made up front
    consent: str = ""  # shown first; agreement is logged with this text's SHA-256; "" shows nothing
    closing: str | None = None  # the last screen; absent: thanks in the study's language
    break_s: float = 0.0  # the shortest break between blocks, seconds
    language: str = "en"  # of the interface's words: en de fr es zh ja ar, or another with all its [words]
    fonts: tuple[str, ...] = ()  # files of faces installed where the study runs, asked for a character before ours


class Keys(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The keys that participants may find their actions on."""

    pool: tuple[str, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")  # physical keys, study/keys.py
    spare: Spare = "ignore"  # pool keys left over: nothing happens, or a block's distractors
    check: bool = True  # each pool key is pressed once before data are taken


class Group(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A condition: what its participants do, in order."""

    name: str
    blocks: tuple[str, ...] = ()  # names of blocks; consent, keyboard check and closing come by themselves
    parts: tuple[str, ...] = ()  # or names of pages, questions, blocks and orders, where there are no [[sessions]]
    ratio: int = 1  # how many participants for one of a group with ratio 1
    instead: dict[str, str] = {}  # part -> the part this group has in its place; "" leaves it out


class Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Episodes played in one world under one rule."""

    name: str
    world: str  # "minihuman/MiniGrid-FourRooms-v0", "module:Id-v0"
    episodes: int
    actions: tuple[str, ...]  # the world's actions that get a key; carried maps go by position in this list
    max_steps: int  # an episode is a timeout after so many
    options: dict[str, Any] = {}  # keyword arguments of gymnasium.make
    seeds: Literal["new", "same"] | tuple[int, ...] = "new"
    key_map: KeyMapPolicy = "fresh"
    distractors: tuple[str, ...] = ()  # actions dealt to spare keys when keys.spare = "distractor"
    pace: PacePolicy = "on_key"
    step_period_ms: float = 0.0  # real_time: the time between steps
    noop: str | None = None  # real_time: the action of a tick without a key; absent: such a tick is no step
    auto_repeat: bool = False  # on_key: holding a key steps again
    view: View = "partial"
    palette: Palette = "classic"
    record_observations: bool = False  # the log holds what was observed, beside its hash
    instruction: str = ""
    feedback: str | dict[Literal["goal", "timeout", "failure"], str] = ""  # after each episode, or by its outcome
    rest: str = ""  # after the block, when another follows
    fixed: dict[str, str] = {}  # key_map = "fixed": physical key -> action
    show_keys: bool = False  # the keys are on the screen, as with key_map = "shown"
    title: str = ""  # above the instruction; absent: "Part 1 of 2"
    mission: str = ""  # what is to be done, instead of the world's words
    until: Criterion | None = None  # the block is over as soon as it is met
    max_s: float = 0.0  # an episode's longest playing time, seconds; 0: none
    block_max_s: float = 0.0  # the block's
    interval_ms: float = 0.0  # an empty screen before each episode
    fixation_ms: float = 0.0  # then a cross
    hold_ms: float = 500.0  # the last picture stays
    marks: bool = False  # and carries a mark and a colour for the outcome
    points: Points | None = None
    show_points: bool = False  # the running total is on the screen
    kind: str = "play"  # or another kind of block: "takeover", "rating", ...
    agent: AgentPlan | None = None  # that plays, where the kind has one
    for_group: Override = {}


class Exclusion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A rule, fixed before the data are seen, for what the report leaves out."""

    reason: str
    level: Literal["episode", "participant"]
    measure: str  # a column of the report's episode or participant table
    below: float | None = None  # leaves out values less than this
    above: float | None = None  # leaves out values greater than this


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A study's protocol. ``decode`` is the only way to make one from a file."""

    study: Study
    groups: tuple[Group, ...]
    blocks: tuple[Block, ...] = ()
    keys: Keys = Keys()
    exclusions: tuple[Exclusion, ...] = ()
    pages: tuple[Text, ...] = ()
    questions: tuple[Questionnaire, ...] = ()
    activities: tuple[Other, ...] = ()
    orders: tuple[Order, ...] = ()
    sessions: tuple[Day, ...] = ()
    words: dict[str, Any] = {}  # the interface's words in other words, by table as in minihuman/study/words
    bonus: Bonus | None = None
    files: dict[str, bytes] = {}  # what the file names beside itself; not a field of the file
    about: facts.About = facts.About()
    analysis: judged.Analysis = judged.Analysis()
    allocation: alike.Allocation = alike.Allocation()
    devices: tuple[apparatus.Device, ...] = ()
    web: browsers.Online = browsers.Online()
    toml: bytes = b""  # the file itself, byte for byte; not a field of the file

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, hexadecimal."""
        return hashlib.sha256(self.toml).hexdigest()

    def block(self, name: str) -> Block:
        """The block of that name."""
        return next(block for block in self.blocks if block.name == name)

    def block_for(self, name: str, group: str) -> Block:
        """The block of that name as a group has it."""
        return as_for(self.block(name), group)

    def page_for(self, name: str, group: str) -> Text | None:
        """The page of that name as a group has it; None if there is none."""
        return next((as_for(page, group) for page in self.pages if page.name == name), None)

    def questions_for(self, name: str, group: str) -> Questionnaire | None:
        """The questions of that name as a group has them; None if there are none."""
        return next((as_for(asked, group) for asked in self.questions if asked.name == name), None)

    @property
    def designed(self) -> bool:
        """Whether the file lists parts itself, in sessions or in groups."""
        return bool(self.sessions) or any(group.parts for group in self.groups)

    def group(self, name: str) -> Group:
        """The group of that name.

        Raises:
            ProtocolError: if there is none.
        """
        for group in self.groups:
            if group.name == name:
                return group
        names = ", ".join(group.name for group in self.groups)
        raise ProtocolError(f"no group {name!r} in study {self.study.name!r}; it has {names}")


_Rules = Callable[[Protocol], Iterable[Complaint]]


def decode(toml: bytes, source: str = "protocol", files: Mapping[str, bytes] | None = None) -> Protocol:
    """Read a protocol file's bytes; ``source`` names the file in errors, ``files`` are those it names beside itself.

    Raises:
        ProtocolError: of every mistake, a line each with file, line, path, value and the way out.
    """
    return _decode(toml, source, files or {}, (_impossible, _impossible_by_later_rules))


def decode_logged(toml: bytes, source: str = "the protocol in a log") -> Protocol:
    """Read the protocol that a session was played by; it need not keep rules that came after it.

    Raises:
        ProtocolError: as ``decode``.
    """
    return _decode(toml, source, {}, (_impossible,))


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
        raise ProtocolError(f"{source}: byte {error.start} is not UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise ProtocolError(f"{source}: not TOML: {error}") from None
    wrong = list(structural(tree, Protocol))
    if not wrong:
        protocol = msgspec.convert(tree, Protocol)
        wrong = [complaint for rule in rules for complaint in rule(protocol)]
    if mistakes := told(wrong, source=source, text=text, tree=tree):
        raise mistakes
    return msgspec.structs.replace(protocol, toml=toml, files=dict(files))


def _impossible(protocol: Protocol) -> list[Complaint]:
    """Every (path, complaint) about values that have the right type but make no study."""
    return [
        *_study_complaints(protocol.study),
        *_keys_complaints(protocol.keys),
        *_group_complaints(protocol),
        *of_each("blocks", protocol.blocks, lambda block: _block_complaints(block, protocol)),
        *(
            (f"$.blocks[{number}].{field}", complaint)
            for number, block in enumerate(protocol.blocks)
            for field, complaint in _of_no_use(block, protocol.keys)
        ),
        *design_complaints(protocol),
        *facts.complaints(protocol.about),
        *judged.complaints(protocol.analysis, tuple(block.name for block in protocol.blocks)),
        *alike.complaints(protocol),
        *apparatus.complaints(protocol.devices),
        *browsers.complaints(protocol.web),
        *(
            (f"$.exclusions[{number}]", "has neither below nor above; give one of them")
            for number, rule in enumerate(protocol.exclusions)
            if rule.below is None and rule.above is None
        ),
    ]


def _impossible_by_later_rules(protocol: Protocol) -> list[Complaint]:
    """The same, by rules without which studies were run before there were any."""
    return [
        *of_each_group("blocks", protocol.blocks, lambda block: _block_complaints(block, protocol)),
        *carry_complaints(protocol),
        *later_design_complaints(protocol),
    ]


def _study_complaints(study: Study) -> list[Complaint]:
    found = []
    if not _NAME.fullmatch(study.name):
        found.append(("$.study.name", f"is {study.name!r}; use lower-case letters, digits, '-' and '_'"))
    if not 0 <= study.seed <= MAX_SEED:
        found.append(("$.study.seed", f"is {study.seed}; a seed is 0 or more"))
    if not 1 <= study.participants <= 100_000:
        found.append(("$.study.participants", f"is {study.participants}; use 1 to 100000"))
    if not 0 <= study.break_s <= 86_400:
        found.append(("$.study.break_s", f"is {study.break_s}; a break is 0 to 86400 s"))
    return found


def _keys_complaints(keys: Keys) -> list[Complaint]:
    found = []
    for number, key in enumerate(keys.pool):
        if key not in KEY_NAMES:
            close = difflib.get_close_matches(key, KEY_NAMES, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"keys are called {KEYS_IN_WORDS}"
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which is no key; {hint}"))
        elif key in RESERVED:
            found.append((f"$.keys.pool[{number}]", f"is {key!r}, which the session itself uses; choose another"))
        elif key in keys.pool[:number]:
            found.append((f"$.keys.pool[{number}]", f"is {key!r} again; name each key once"))
    return found


def _group_complaints(protocol: Protocol) -> list[Complaint]:
    if not protocol.groups:
        return [("$.groups", "is empty; a study has one group or more")]
    if not protocol.blocks and not protocol.designed:
        return [("$.blocks", "is empty; a study has one block or more, or parts that are not played")]
    found = [*_name_complaints("groups", protocol.groups), *_name_complaints("blocks", protocol.blocks)]
    names = [block.name for block in protocol.blocks]
    for number, group in enumerate(protocol.groups):
        if not group.blocks and not protocol.designed:
            found.append((f"$.groups[{number}].blocks", "is empty; a group plays one block or more"))
        for place, name in enumerate(group.blocks):
            if name not in names:
                path = f"$.groups[{number}].blocks[{place}]"
                found.append((path, f"is {name!r}, which is no block; blocks: {', '.join(names)}"))
    return found


def _name_complaints(field: str, named: tuple[Group, ...] | tuple[Block, ...]) -> list[Complaint]:
    found = []
    names = [item.name for item in named]
    for number, name in enumerate(names):
        path = f"$.{field}[{number}].name"
        if not _NAME.fullmatch(name):
            found.append((path, f"is {name!r}; use lower-case letters, digits, '-' and '_'"))
        if name in names[:number]:
            found.append((path, f"is {name!r} again; give each its own name"))
    return found


def _block_complaints(block: Block, protocol: Protocol) -> list[Complaint]:
    found = []
    pool = len(protocol.keys.pool)
    if not block.world:
        found.append(("world", "is empty; `minihuman worlds` lists ours"))
    if not 1 <= block.episodes <= 10_000:
        found.append(("episodes", f"is {block.episodes}; an episode count is 1 to 10000"))
    if not 1 <= block.max_steps <= 1_000_000:
        found.append(("max_steps", f"is {block.max_steps}; use 1 to 1000000"))
    if not block.actions:
        found.append(("actions", "is empty; name the actions that get a key"))
    twice = [name for name, count in Counter(block.actions + block.distractors).items() if count > 1]
    if twice:
        found.append(("actions", f"and distractors name {', '.join(map(repr, twice))} twice; name each once"))
    if len(block.actions) > pool:
        found.append(("actions", f"has {len(block.actions)} for {pool} keys in $.keys.pool; add keys"))
    if protocol.keys.spare == "distractor" and not block.distractors:
        found.append(("distractors", "is empty, but $.keys.spare is 'distractor'; name the actions to deal out"))
    if isinstance(block.seeds, tuple):
        if len(block.seeds) != block.episodes:
            found.append(("seeds", f"has {len(block.seeds)} seeds for {block.episodes} episodes; give one an episode"))
        if any(not 0 <= seed <= MAX_SEED for seed in block.seeds):
            found.append(("seeds", "has a negative seed; a seed is 0 or more"))
    if block.pace == "real_time" and not 5 <= block.step_period_ms <= 60_000:
        found.append(("step_period_ms", f"is {block.step_period_ms}; real_time needs 5 to 60000 ms"))
    for text in [block.feedback] if isinstance(block.feedback, str) else block.feedback.values():
        try:
            _check_placeholders(text)
            text.format(outcome="", reward=0.0, steps=0, episode=0, episodes=0, points=0.0, total=0.0)
        except (KeyError, IndexError, ValueError, AttributeError) as error:
            fields = "outcome, reward, steps, episode, episodes, points, total"
            found.append(("feedback", f"has a bad placeholder ({error}); use {fields}"))
    return found


def _of_no_use(block: Block, keys: Keys) -> list[Complaint]:
    """What is given and does nothing."""
    found = []
    if keys.spare == "ignore" and block.distractors:
        found.append(("distractors", "has actions, but $.keys.spare is 'ignore'; set it to 'distractor'"))
    if block.pace == "on_key" and (block.step_period_ms or block.noop is not None):
        found.append(("pace", "is 'on_key', which has no step_period_ms and no noop; remove them or use 'real_time'"))
    if block.pace == "real_time" and block.auto_repeat:
        found.append(("auto_repeat", "is for 'on_key'; in 'real_time' a tick decides"))
    return found


def _check_placeholders(text: str) -> None:
    """Refuse placeholders that are more than a field and a short format: they could ask for a text of any size.

    Raises:
        ValueError: if there is one.
    """
    for _, field, format_spec, conversion in Formatter().parse(text):
        if field is not None and (not field.isidentifier() or conversion or not _FORMAT.fullmatch(format_spec or "")):
            raise ValueError(f"{{{field}{':' if format_spec else ''}{format_spec}}}")
