"""Protocol files: write a first one from a few answers, read one with its pictures and policies, find a shipped one.

Shipped protocols lie inside the package when it is installed, and beside it in a checkout.
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
from minihuman.experiment.plan.trials import read_images
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol, list_old_names
from minihuman.experiment.protocol.specs import Overridable, apply_overrides
from minihuman.experiment.words import ENGLISH, load_words
from minihuman.trust import NamedWorld, Permission, admit_worlds
from minihuman.worlds.adapters.world import World

_USUAL_WORLD = "minihuman/MiniGrid-FourRooms-v0"
_USUAL_WORLDS = {  # of templates
    "trials": "minihuman/Stimulus-v0",
    "team": "minihuman/Team-CrampedRoom-v0",
    "two-groups": f"minihuman/MiniGrid-Empty-Random-6x6-v0,minihuman/MiniGrid-MultiRoom-N2-S4-v0,{_USUAL_WORLD}",
}
_STEPS = 100  # where the world has no limit of its own
_MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down")
SCHEMA_FILE = "minihuman.schema.json"
MAX_PROTOCOL_BYTES = 2**20
MAX_PICTURE_BYTES = 2**24
MAX_PICTURE_PIXELS = 4096 * 4096
MAX_POLICY_BYTES = 2**25


TEMPLATES = {  # what a new study may have beside a block: several go together
    "two-groups": "worlds in opposite orders, a questionnaire",
    "two-days": "two sessions, with days between them",
    "three-groups": "keys to be found out, shown, or the same for all",
    "trials": "go/no-go trials instead of a world",
    "browser": "participants in a browser",
    "team": "two people in one world",
}
_STAGED = frozenset({"two-days", "three-groups"})
_STAGES = {"practice": 0, "task-a": 0, "task-b": -1}  # each with the place of its world


@dataclass(frozen=True, slots=True)
class ProtocolDraft:
    """What a new study is to be."""

    name: str = "my-study"
    world: str = ""  # or several, with commas; "": the template's
    episodes: int = 5
    participants: int = 20
    keys: str = "new"  # found by trying, or "shown"
    templates: tuple[str, ...] = ()  # of TEMPLATES
    language: str = ENGLISH

    @property
    def worlds(self) -> list[str]:
        """The worlds, in order; the template's where none is named."""
        usual = (world for name, world in _USUAL_WORLDS.items() if self.has(name))
        return [world.strip() for world in (self.world or next(usual, _USUAL_WORLD)).split(",")]

    @property
    def staged(self) -> bool:
        """Whether it has practice and two tasks."""
        return not _STAGED.isdisjoint(self.templates)

    def has(self, template: str) -> bool:
        """Whether it is made from a template."""
        return template in self.templates

    def toml(self) -> str:
        """The protocol file, with what else there is as comments.

        Raises:
            ProtocolError: if the answers make no study, or there is no such template.
            WorldError: if there is no such world.
        """
        from jinja2 import Environment, StrictUndefined  # which a station that runs sessions does without

        if wrong := [name for name in self.templates if name not in TEMPLATES]:
            raise ProtocolError(f"template {wrong[0]!r} is unknown; templates: {', '.join(TEMPLATES)}")
        kinds = [
            name for name in self.templates if name in _USUAL_WORLDS or (self.has("two-groups") and name in _STAGED)
        ]
        if len(kinds) > 1:
            raise ProtocolError(f"templates {kinds[0]!r} and {kinds[1]!r} are two kinds of study; choose one")
        jinja = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
        folder = files(__package__).joinpath("templates")
        written = tomllib.loads(folder.joinpath("texts.toml").read_text(encoding="utf-8"))
        template = folder.joinpath("study.toml.j2").read_text(encoding="utf-8")
        tasks = [self._task(world) for world in self.worlds]
        numbered = {f"world-{number}": number - 1 for number in range(1, len(tasks) + 1)}
        if self.staged:
            places = _STAGES
        elif len(tasks) > 1:
            places = numbered
        else:
            places = {"play": 0}
        text = jinja.from_string(template).render(
            draft=self,
            schema=SCHEMA_FILE,
            seed=sum(ord(letter) * 31**place for place, letter in enumerate(self.name)) % 10**6,
            untranslated="" if self.language in written else _list_english_words(),
            texts=written.get(self.language, written[ENGLISH]),
            pool=[*dict.fromkeys(key for task in tasks for key in task["pool"])],
            blocks=[{"name": name, **tasks[place]} for name, place in places.items()],
        )
        decode_protocol(text.encode(), f"{self.name}.toml")
        return text

    def describe_outcomes(self) -> list[str]:
        """Describe what an end means in each of the worlds, and who says so."""
        return [f"outcome in {world_id}: {find_world_rule(world_id).describe()}" for world_id in self.worlds]

    def _task(self, world_id: str) -> dict[str, Any]:
        """A world with its keys and pace."""
        from minihuman.experiment.plan.dry_run import find_needed_actions  # the planner, which only a new study needs

        trials = self.has("trials")
        team = self.has("team")
        options = {"responses": ["press"]} if trials else {}
        with closing(World(world_id, options, trusted=True)) as world:
            names = world.action_names
            limit = world.step_limit
            keys = assign_usual_keys(world)
            noop = find_noop(world)
            period_ms = find_period_ms(world)
            useful = {*_MOVES, *find_needed_actions(world)}
        if trials:
            keys = {"space": "press"}
            period_ms = None
        elif team:
            keys = {key: name for key, name in keys.items() if name in names[:5]}
            period_ms = 150.0
        free = period_ms is None and not trials  # which key does what is drawn
        moves = [name for name in names if name in useful] or list(names)
        actions = moves[:9] if free else list(keys.values())
        keys = dict(zip(DIGITS, actions, strict=False)) if free else keys
        pairs = ", ".join(f'{key} = "{action}"' for key, action in keys.items())
        return {
            "free": free,
            "world": world_id,
            "actions": actions,
            "others": "" if trials else ", ".join(name for name in names if name not in actions) or "none",
            "max_steps": 1 if trials else limit or _STEPS,
            "pool": [*DIGITS[:9]] if free else [*keys],
            "key_map": "fixed" if not free else "constant" if self.staged or self.has("two-groups") else self.keys,
            "fixed": "" if free or trials else pairs,
            "given": pairs,
            "period_ms": None if period_ms is None else round(period_ms, 3),
            "noop": noop,
        }


def _list_english_words() -> str:
    """``[words]`` of a language that is not ours, to be translated."""
    tables: dict[str, list[str]] = {}
    for key, text in load_words(ENGLISH).items():
        table, _, name = key.rpartition(".")
        if table != "mission":
            tables.setdefault(table, []).append(f"{name} = {json.dumps(text, ensure_ascii=False)}")
    return "\n".join(
        "\n".join([f"[words.{table}]" if table else "[words]", *lines, ""]) for table, lines in tables.items()
    )


def make_study_name(words: str) -> str:
    """A name as a study's has to be, from whatever was typed.

    Raises:
        ProtocolError: if nothing is left of it.
    """
    name = re.sub(r"[^a-z0-9_]+", "-", words.lower()).strip("-_")[:64]
    if not name:
        raise ProtocolError(f"{words!r} is not a valid study name; use lower-case letters, digits, '-' and '_'")
    return name


def read_protocol(path: Path, *, trust: Permission = False) -> Protocol:
    """Read and check a protocol file with its pictures and policies, all in its folder once links are followed.

    Python files in the folder can be the modules of its worlds from then on, if the user trusts the folder.
    Warns (``FutureWarning``) of each field or value under an old name.

    Args:
        path: the TOML file.
        trust: whether to trust the folder if it is not trusted yet, or what asks the user.

    Raises:
        ProtocolError: if it cannot be read, says something impossible, or runs Python that is not trusted; one line
            with the way out.
    """
    try:
        toml = _read_file(path, MAX_PROTOCOL_BYTES)
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    protocol = decode_protocol(toml, str(path))
    for line in list_old_names(protocol, str(path)):
        warnings.warn(line, FutureWarning, stacklevel=2)
    folder = path.resolve().parent
    if refused := admit_worlds(_find_worlds(msgspec.to_builtins(protocol)), folder, trust):
        raise ProtocolError(
            f"{path} runs Python or reads files from {refused}, which you do not trust yet; read its code, then add "
            "--trust"
        )
    pictures = _find_pictures(protocol)
    policies = _find_policies(protocol)
    named = {name: _read_picture(folder, name, f"{path}: {where}") for name, where in pictures.items()}
    named |= {name: _read_policy(folder, name, f"{path}: {where}") for name, where in policies.items()}
    named |= _read_stimuli(protocol, folder, path)
    return msgspec.structs.replace(protocol, files=named)


def _find_worlds(value: object) -> Iterator[NamedWorld]:
    """Every world that a table of a protocol names, in the overrides of a group too."""
    if isinstance(value, Mapping):
        if isinstance(value.get("world"), str) or isinstance(value.get("options"), Mapping):
            world = value.get("world")
            options = value.get("options")
            yield world if isinstance(world, str) else "", options if isinstance(options, Mapping) else {}
        value = tuple(value.values())
    if isinstance(value, list | tuple):
        for each in value:
            yield from _find_worlds(each)


def _find_pictures(protocol: Protocol) -> dict[str, str]:
    """The pictures of its pages, each with the field that names it."""
    logo = {protocol.study.logo: "$.study.logo"} if protocol.study.logo else {}
    pages = _in_any_group(protocol, protocol.pages)
    return logo | {name: f"$.pages[{number}].images" for number, page in pages for name in page.images}


def _in_any_group(protocol: Protocol, parts: Sequence[Overridable]) -> list[tuple[int, Overridable]]:
    """Each part's place and the part, as each group has it."""
    return [(place, apply_overrides(part, group.name)) for place, part in enumerate(parts) for group in protocol.groups]


def _find_policies(protocol: Protocol) -> dict[str, str]:
    """The policy files of its agents in any group, each with the field that names it."""
    blocks = _in_any_group(protocol, protocol.blocks)
    named = [
        *((f"{number}].agent.policy", its.agent.policy) for number, its in blocks if its.agent),
        *((f"{number}].team", name) for number, its in blocks if its.team for name in its.team.agents),
    ]
    return {
        name: f"$.blocks[{where}"
        for where, name in named
        if name and name != LATEST_POLICY and not name.startswith(f"{SIMULATED}:") and not is_registered_agent(name)
    }


def _read_stimuli(protocol: Protocol, folder: Path, path: Path) -> dict[str, bytes]:
    """The tables of stimuli and the images that they name."""
    found: dict[str, bytes] = {}
    for number, block in _in_any_group(protocol, protocol.blocks):
        if block.stimuli is not None:
            where = f"{path}: $.blocks[{number}].stimuli"
            name = block.stimuli.file
            if name:
                found[name] = _read_beside(
                    folder, name, where, MAX_PROTOCOL_BYTES, "copy it into the protocol's folder"
                )
            for image, place in read_images(block.stimuli, found):
                found[image] = _read_picture(folder, image, f"{where}: {place}: column 'image'")
    return found


def _read_picture(folder: Path, name: str, where: str) -> bytes:
    content = _read_beside(folder, name, where, MAX_PICTURE_BYTES, "copy it into the protocol's folder")
    try:
        with warnings.catch_warnings(), Image.open(io.BytesIO(content), formats=("PNG",)) as image:
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # larger ones are refused here
            if image.width * image.height <= MAX_PICTURE_PIXELS:
                image.load()
                return content
            problem = f"has {image.width} x {image.height} pixels; use {MAX_PICTURE_PIXELS} at most"
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        cut = "damaged" if content.startswith(b"\x89PNG") else "not a PNG"
        problem = f"is {cut} ({type(error).__name__}); save it as a PNG"
    raise ProtocolError(f"{where}: {folder / name} {problem}")


def _read_policy(folder: Path, name: str, where: str) -> bytes:
    cure = "copy the policy file into the protocol's folder, or name a registered agent"
    content = _read_beside(folder, name, where, MAX_POLICY_BYTES, cure)
    try:
        make_policy_agent(folder / name)
    except MinihumanError as error:
        raise ProtocolError(f"{where}: {error}") from error
    return content


def _read_beside(folder: Path, name: str, where: str, limit: int, cure: str) -> bytes:
    """Read a file of the protocol's folder, which is given without links.

    Raises:
        ProtocolError: if it is no regular file in it, is larger than ``limit``, or cannot be read.
    """
    try:
        path = (folder / name).resolve(strict=True)
        if not path.is_relative_to(folder):
            raise ProtocolError(f"{where}: {name!r} is outside the protocol's folder; {cure}")
        return _read_file(path, limit)
    except (OSError, ValueError, RuntimeError) as error:
        if isinstance(error, ProtocolError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise ProtocolError(f"{where}: {folder / name} cannot be read: {reason}; {cure}") from error


def _read_file(path: Path, limit: int) -> bytes:
    """Read a regular file of a limited size.

    Raises:
        OSError: if it is a device or the like, is too large, or cannot be read.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    with path.open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"it is larger than {limit} bytes")
    return content


_PACKAGE = Path(__file__).parents[1]


def find_shipped_protocol(name: str) -> Path:
    """Where a shipped protocol's TOML file is, by the file's name without its ending."""
    inside = _PACKAGE / "protocols" / f"{name}.toml"
    if inside.exists():
        return inside
    return _PACKAGE.parent / "protocols" / f"{name}.toml"
