"""Protocol files: write a first one from a few answers, read one with its pictures and policies, or find a shipped one.

Shipped protocols are inside the installed package, or beside it in a source checkout.
"""

import errno
import io
import json
import re
import stat
import tomllib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec
from PIL import Image

from minihuman.activities.agent_blocks.plan import LATEST_POLICY
from minihuman.activities.team.plan import SIMULATED
from minihuman.agents.agent import is_registered_agent, make_policy_agent
from minihuman.errors import MinihumanError, ProtocolError
from minihuman.experiment.keys import DIGITS, assign_usual_keys, find_noop, find_period_ms
from minihuman.experiment.plan.stated_outcomes import find_world_rule
from minihuman.experiment.plan.trials import (
    TIMELINE_IMAGE_FORMATS,
    read_images,
    read_timeline_images,
    read_timeline_sounds,
)
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol, list_old_names
from minihuman.experiment.protocol.specs import Overridable, apply_overrides
from minihuman.experiment.words import ENGLISH, load_words
from minihuman.trust import NamedWorld, Permission, admit_worlds
from minihuman.worlds.adapters.world import World

_USUAL_WORLD = "minihuman/MiniGrid-FourRooms-v0"
_USUAL_WORLDS = {  # by template
    "trials": "minihuman/Stimulus-v0",
    "team": "minihuman/Team-CrampedRoom-v0",
    "two-groups": f"minihuman/MiniGrid-Empty-Random-6x6-v0,minihuman/MiniGrid-MultiRoom-N2-S4-v0,{_USUAL_WORLD}",
}
_STEPS = 100  # step limit for a world that has none
_TEAM_PERIOD_MS = 150.0  # between the joint steps of a new team study
_MAX_DRAWN_KEYS = 9  # the digits 1 to 9
_MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down")
SCHEMA_FILE = "minihuman.schema.json"
MAX_PROTOCOL_BYTES = 2**20
MAX_PICTURE_BYTES = 2**24
MAX_PICTURE_PIXELS = 4096 * 4096
MAX_POLICY_BYTES = 2**25
MAX_SOUND_BYTES = 2**24


TEMPLATES = {  # what a new study may contain besides a block; several can be combined
    "two-groups": "worlds in opposite orders, a questionnaire",
    "two-days": "two sessions, with days between them",
    "three-groups": "keys to be found out, shown, or the same for all",
    "trials": "go/no-go trials instead of a world",
    "browser": "participants in a browser",
    "team": "two people in one world",
}
_STAGED = frozenset({"two-days", "three-groups"})
_STAGES = {"practice": 0, "task-a": 0, "task-b": -1}  # the index of each block's world


@dataclass(frozen=True, slots=True)
class ProtocolDraft:
    """The answers from which a new study's protocol is written."""

    name: str = "my-study"
    world: str = ""  # one or several ids, separated by commas; "" for the template's
    episodes: int = 5
    participants: int = 20
    keys: str = "new"  # "new" if keys are to be discovered, or "shown"
    templates: tuple[str, ...] = ()  # names in TEMPLATES
    language: str = ENGLISH

    @property
    def worlds(self) -> list[str]:
        """Return the ids of the worlds, in order; those that are usual for the draft's templates if none is given."""
        ids = self.world
        if not ids:
            template_ids = (ids for template, ids in _USUAL_WORLDS.items() if self.has(template))
            ids = next(template_ids, _USUAL_WORLD)
        return [world_id.strip() for world_id in ids.split(",")]

    @property
    def staged(self) -> bool:
        """Return whether the study has a practice block and two tasks."""
        return not _STAGED.isdisjoint(self.templates)

    def has(self, template: str) -> bool:
        """Return whether the study uses a template."""
        return template in self.templates

    def toml(self) -> str:
        """Return the text of the protocol file, with further options as comments.

        Raises:
            ProtocolError: if the answers do not make a valid study, or a template does not exist.
            WorldError: if a world does not exist.
        """
        from jinja2 import Environment, StrictUndefined  # which a station that runs sessions does without

        self._check_templates()
        jinja = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
        folder = files(__package__).joinpath("templates")
        texts_by_language = tomllib.loads(folder.joinpath("texts.toml").read_text(encoding="utf-8"))
        template = folder.joinpath("study.toml.j2").read_text(encoding="utf-8")
        tasks = [self._describe_task(world) for world in self.worlds]
        text = jinja.from_string(template).render(
            draft=self,
            schema=SCHEMA_FILE,
            seed=self._derive_seed(),
            untranslated="" if self.language in texts_by_language else _format_english_words(),
            texts=texts_by_language.get(self.language, texts_by_language[ENGLISH]),
            pool=[*dict.fromkeys(key for task in tasks for key in task["pool"])],
            blocks=[{"name": name, **tasks[index]} for name, index in self._assign_worlds_to_blocks().items()],
        )
        decode_protocol(text.encode(), f"{self.name}.toml")
        return text

    def _check_templates(self) -> None:
        """Require that all templates exist and can be combined.

        Raises:
            ProtocolError: if one does not exist, or two exclude each other.
        """
        unknown = [name for name in self.templates if name not in TEMPLATES]
        if unknown:
            raise ProtocolError(f"template {unknown[0]!r} is unknown; templates: {', '.join(TEMPLATES)}")
        exclusive = set(_USUAL_WORLDS)
        if self.has("two-groups"):
            exclusive |= _STAGED
        conflicting = [name for name in self.templates if name in exclusive]
        if len(conflicting) > 1:
            raise ProtocolError(
                f"templates {conflicting[0]!r} and {conflicting[1]!r} are two kinds of study; choose one"
            )

    def _derive_seed(self) -> int:
        """Derive the study's seed, of at most six digits, from its name by a polynomial hash."""
        digest = 0
        for index, letter in enumerate(self.name):
            digest += ord(letter) * 31**index
        return digest % 10**6

    def _assign_worlds_to_blocks(self) -> dict[str, int]:
        """Return the index in ``worlds`` of each block's world, by the block's name."""
        if self.staged:
            return _STAGES
        if len(self.worlds) > 1:
            return {f"world-{index + 1}": index for index in range(len(self.worlds))}
        return {"play": 0}

    def describe_outcomes(self) -> list[str]:
        """Describe, for each world, the rule that decides an episode's outcome and where it comes from."""
        return [f"outcome in {world_id}: {find_world_rule(world_id).describe()}" for world_id in self.worlds]

    def _describe_task(self, world_id: str) -> dict[str, Any]:
        """Return the template's variables for a world: its keys, pace and step limit."""
        from minihuman.experiment.plan.dry_run import find_needed_actions  # the planner, which only a new study needs

        options = {}
        if self.has("trials"):
            options = {"responses": ["press"]}
        with closing(World(world_id, options, trusted=True)) as world:
            names = world.action_names
            keys = assign_usual_keys(world)
            period_ms = find_period_ms(world)
            useful = {*_MOVES, *find_needed_actions(world)}
            max_steps = world.step_limit or _STEPS
            task: dict[str, Any] = {"world": world_id, "max_steps": max_steps, "noop": find_noop(world)}
        if self.has("trials"):
            return task | {"max_steps": 1, "others": "", **_describe_fixed_keys({"space": "press"}), "fixed": ""}
        if self.has("team"):
            keys = {key: name for key, name in keys.items() if name != task["noop"]}
            period_ms = _TEAM_PERIOD_MS
        if period_ms is not None:
            task |= _describe_fixed_keys(keys) | {"period_ms": round(period_ms, 3)}
        else:
            moves = [name for name in names if name in useful] or list(names)
            task |= self._describe_drawn_keys(moves[:_MAX_DRAWN_KEYS])
        return task | {"others": ", ".join(name for name in names if name not in task["actions"]) or "none"}

    def _describe_drawn_keys(self, actions: list[str]) -> dict[str, Any]:
        """Return the template's variables for a block whose keys are drawn at random for these actions."""
        key_map = self.keys
        if self.staged or self.has("two-groups"):
            key_map = "constant"
        return {
            "free": True,
            "actions": actions,
            "pool": [*DIGITS[:_MAX_DRAWN_KEYS]],
            "key_map": key_map,
            "fixed": "",
            "given": _format_keys(dict(zip(DIGITS, actions, strict=False))),
            "period_ms": None,
        }


def _describe_fixed_keys(keys: Mapping[str, str]) -> dict[str, Any]:
    """Return the template's variables for a block whose keys have fixed actions, given the action of each key."""
    pairs = _format_keys(keys)
    return {
        "free": False,
        "actions": list(keys.values()),
        "pool": [*keys],
        "key_map": "fixed",
        "fixed": pairs,
        "given": pairs,
        "period_ms": None,
    }


def _format_keys(keys: Mapping[str, str]) -> str:
    return ", ".join(f'{key} = "{action}"' for key, action in keys.items())


def _format_english_words() -> str:
    """Format the ``[words]`` tables in English as TOML, to be translated for a language that is not shipped."""
    tables: dict[str, list[str]] = {}
    for key, text in load_words(ENGLISH).items():
        table, _, name = key.rpartition(".")
        if table != "mission":
            tables.setdefault(table, []).append(f"{name} = {json.dumps(text, ensure_ascii=False)}")
    formatted_tables = []
    for table, lines in tables.items():
        head = f"[words.{table}]" if table else "[words]"
        formatted_tables.append("\n".join([head, *lines, ""]))
    return "\n".join(formatted_tables)


def make_study_name(words: str) -> str:
    """Turn any text into a valid study name.

    Raises:
        ProtocolError: if no valid character is left.
    """
    name = re.sub(r"[^a-z0-9_]+", "-", words.lower()).strip("-_")[:64]
    if not name:
        raise ProtocolError(f"{words!r} is not a valid study name; use lower-case letters, digits, '-' and '_'")
    return name


def read_protocol(path: Path, *, trust: Permission = False) -> Protocol:
    """Read and check a protocol file with its pictures and policies, which must be in its folder after following links.

    If the user trusts the folder, its Python files can be imported as the worlds' modules from then on. Each field or
    value under an old name causes a ``FutureWarning``.

    Args:
        path: the TOML file.
        trust: whether to trust the folder if it is not trusted yet, or a function that asks the user.

    Raises:
        ProtocolError: if the file cannot be read, is not valid, or runs Python that is not trusted; one line that
            includes a remedy.
    """
    try:
        toml = _read_file(path, MAX_PROTOCOL_BYTES)
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    protocol = decode_protocol(toml, str(path))
    for message in list_old_names(protocol, str(path)):
        warnings.warn(message, FutureWarning, stacklevel=2)
    folder = path.resolve().parent
    refused = admit_worlds(list_named_worlds(msgspec.to_builtins(protocol)), folder, trust)
    if refused:
        raise ProtocolError(
            f"{path} runs Python or reads files from {refused}, which you do not trust yet; read its code, then add "
            "--trust"
        )
    pictures = _find_pictures(protocol)
    policies = _find_policies(protocol)
    contents = {name: _read_picture(folder, name, f"{path}: {field}") for name, field in pictures.items()}
    contents |= {name: _read_policy(folder, name, f"{path}: {field}") for name, field in policies.items()}
    contents |= _read_stimuli(protocol, folder, path)
    return msgspec.structs.replace(protocol, files=contents)


def list_named_worlds(node: object) -> Iterator[NamedWorld]:
    """Yield the id and options of every world that a protocol's table names, including the overrides of groups.

    The id is "" in a table that has options only; the options are empty in a table that has a world only.

    Args:
        node: a protocol's table, or anything within it.
    """
    children: tuple[object, ...] = ()
    if isinstance(node, Mapping):
        world = node.get("world")
        options = node.get("options")
        match world, options:
            case str(), Mapping():
                yield world, options
            case str(), _:
                yield world, {}
            case _, Mapping():
                yield "", options
        children = tuple(node.values())
    elif isinstance(node, list | tuple):
        children = tuple(node)
    for child in children:
        yield from list_named_worlds(child)


def _find_pictures(protocol: Protocol) -> dict[str, str]:
    """Return the file names of a protocol's logo and its pages' pictures, each with the field that names it."""
    fields: dict[str, str] = {}
    if protocol.study.logo:
        fields[protocol.study.logo] = "$.study.logo"
    for number, page in _list_group_variants(protocol, protocol.pages):
        for name in page.images:
            fields[name] = f"$.pages[{number}].images"
    return fields


def _list_group_variants(protocol: Protocol, parts: Sequence[Overridable]) -> list[tuple[int, Overridable]]:
    """Return each part once per group, with its index and with the group's overrides applied."""
    return [(index, apply_overrides(part, group.name)) for index, part in enumerate(parts) for group in protocol.groups]


def _find_policies(protocol: Protocol) -> dict[str, str]:
    """Return the names of the policy files of the agents in any group, each with the field that names it."""
    agent_fields: dict[str, str] = {}
    team_fields: dict[str, str] = {}
    for number, block in _list_group_variants(protocol, protocol.blocks):
        if block.agent and block.agent.policy:
            agent_fields[block.agent.policy] = f"$.blocks[{number}].agent.policy"
        if block.team:
            team_fields |= dict.fromkeys(block.team.agents, f"$.blocks[{number}].team")
    fields = agent_fields | team_fields
    return {name: field for name, field in fields.items() if name and _is_policy_file(name)}


def _is_policy_file(name: str) -> bool:
    """Return whether an agent's name in a protocol is that of a policy file, not that of another kind of agent."""
    if name == LATEST_POLICY or name.startswith(f"{SIMULATED}:"):
        return False
    return not is_registered_agent(name)


def _read_stimuli(protocol: Protocol, folder: Path, path: Path) -> dict[str, bytes]:
    """Read the tables of stimuli, and the images and sounds that tables and timelines name.

    Args:
        protocol: the decoded protocol.
        folder: the protocol's folder, resolved.
        path: the protocol's file, which errors name.

    Returns:
        The contents of each file, by the name that the protocol gives it.
    """
    contents: dict[str, bytes] = {}
    for number, block in _list_group_variants(protocol, protocol.blocks):
        if block.stimuli is not None:
            field = f"{path}: $.blocks[{number}].stimuli"
            name = block.stimuli.file
            if name:
                contents[name] = _read_from_folder(
                    folder, name, field, MAX_PROTOCOL_BYTES, "copy it into the protocol's folder"
                )
            for image, row in read_images(block.stimuli, contents):
                contents[image] = _read_picture(folder, image, f"{field}: {row}: column 'image'")
        for image, source in read_timeline_images(block, contents):
            field = f"{path}: $.blocks[{number}].timeline: {source}"
            contents[image] = _read_picture(folder, image, field, formats=TIMELINE_IMAGE_FORMATS)
        for sound, source in read_timeline_sounds(block, contents):
            field = f"{path}: $.blocks[{number}].timeline: {source}"
            contents[sound] = _read_from_folder(
                folder, sound, field, MAX_SOUND_BYTES, "copy it into the protocol's folder, or use tone or noise"
            )
    return contents


def _read_picture(folder: Path, name: str, field: str, *, formats: tuple[str, ...] = ("PNG",)) -> bytes:
    """Return the bytes of a picture in the protocol's folder, after checking its size and that it can be decoded.

    Args:
        folder: the protocol's folder, resolved.
        name: the picture's name in the protocol.
        field: the field that names the picture, for errors.
        formats: the formats that are accepted, as Pillow names them.

    Raises:
        ProtocolError: if it cannot be read, is of another format, or is too large.
    """
    content = _read_from_folder(folder, name, field, MAX_PICTURE_BYTES, "copy it into the protocol's folder")
    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(content), formats=formats) as image:
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # large pictures are refused below
            if image.width * image.height <= MAX_PICTURE_PIXELS:
                image.load()
                return content
            problem = f"has {image.width} x {image.height} pixels; use {MAX_PICTURE_PIXELS} at most"
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        defect = "damaged" if content.startswith(b"\x89PNG") else f"not a {' or '.join(formats)}"
        problem = f"is {defect} ({type(error).__name__}); save it as a PNG"
    raise ProtocolError(f"{field}: {folder / name} {problem}")


def _read_policy(folder: Path, name: str, field: str) -> bytes:
    """Return the bytes of a policy file in the protocol's folder, after checking that an agent can be made from it.

    Args:
        folder: the protocol's folder, resolved.
        name: the file's name in the protocol.
        field: the field that names the file, for errors.

    Raises:
        ProtocolError: if the file cannot be read, or no agent can be made from it.
    """
    remedy = "copy the policy file into the protocol's folder, or name a registered agent"
    content = _read_from_folder(folder, name, field, MAX_POLICY_BYTES, remedy)
    try:
        make_policy_agent(folder / name)
    except MinihumanError as error:
        raise ProtocolError(f"{field}: {error}") from error
    return content


def _read_from_folder(folder: Path, name: str, field: str, max_bytes: int, remedy: str) -> bytes:
    """Read a file in the protocol's folder.

    Args:
        folder: the protocol's folder, resolved.
        name: the file's name in the protocol.
        field: the field that names the file, for errors.
        max_bytes: the largest size of the file.
        remedy: what the user can do about an error.

    Raises:
        ProtocolError: if it is not a regular file in the folder, is larger than ``max_bytes``, or cannot be read.
    """
    try:
        path = (folder / name).resolve(strict=True)
        if path.is_relative_to(folder):
            return _read_file(path, max_bytes)
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ProtocolError(f"{field}: {folder / name} cannot be read: {reason}; {remedy}") from error
    raise ProtocolError(f"{field}: {name!r} is outside the protocol's folder; {remedy}")


def _read_file(path: Path, max_bytes: int) -> bytes:
    """Read a regular file of a limited size.

    Raises:
        OSError: if it is not a regular file, is larger than ``max_bytes``, or cannot be read.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    with path.open("rb") as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"it is larger than {max_bytes} bytes")
    return content


_PACKAGE = Path(__file__).parents[1]


def find_shipped_protocol(name: str) -> Path:
    """Return the path of a shipped protocol, given the file's name without its suffix.

    If the installed package does not contain it, the path is that in a source checkout, whether or not it exists.
    """
    path_in_package = _PACKAGE / "protocols" / f"{name}.toml"
    if path_in_package.exists():
        return path_in_package
    return _PACKAGE.parent / "protocols" / f"{name}.toml"
