"""New studies: from a template's answers, from a study that comes with the package, or as a new version of one."""

import json
import re
import tomllib
from functools import cache
from pathlib import Path

from minihuman.admin.protocol_file import (
    SCHEMA_FILE,
    TEMPLATES,
    ProtocolDraft,
    make_study_name,
)
from minihuman.builder.document import TomlDocument
from minihuman.builder.durations import estimate_durations
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.messages import EditRefusal, NewStudyRequest, Template
from minihuman.builder.shipped_studies import ShippedStudy, list_shipped_studies
from minihuman.builder.study_notebook import format_notebook
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import find_installed_kind
from minihuman.experiment.protocol.model import BlockSpec
from minihuman.experiment.protocol.protocol import Protocol, build_json_schema, decode_protocol
from minihuman.storage.durable_files import replace_durably, write_atomically
from minihuman.trust import Trust, list_foreign_modules
from minihuman.worlds.catalogue import is_first_person

_PLAIN = "one-world"
_NOTEBOOK = "notebook"  # the same, with a notebook beside it
_WITHOUT_TEMPLATE = frozenset({"", _PLAIN, _NOTEBOOK})
_LAST_NUMBER = re.compile(r"\d+(?=\D*$)")


def write_draft(draft: ProtocolDraft, folder: Path) -> Path:
    """Write the protocol of a new study into a folder, with the schema that editors read; return the protocol's file.

    The worlds that the draft names are trusted from then on, and so is the folder if it was empty.

    Raises:
        ProtocolError: if the answers do not make a valid study.
        OSError: if it cannot be written.
    """
    text = draft.toml()
    folder.mkdir(parents=True, exist_ok=True)
    is_new = not any(folder.iterdir())  # a folder with files in it may hold Python that the user has not read
    path = folder / f"{draft.name}.toml"
    write_atomically(json.dumps(build_json_schema(), indent=1) + "\n", folder / SCHEMA_FILE)
    write_atomically(text, path)
    Trust(frozenset({folder.resolve()} if is_new else ()), list_foreign_modules(draft.worlds)).record()
    return path


@cache
def list_templates() -> tuple[Template, ...]:
    """Return the studies that can be copied: those that are written from answers, then those of the package."""
    drafts = [(_PLAIN, "one world, keys to be found out"), *TEMPLATES.items()]
    drafts.append((_NOTEBOOK, "one world, and a Jupyter notebook that simulates participants and looks at their data"))
    starts = [_describe_draft(name, summary) for name, summary in drafts]
    return (*starts, *(_describe_shipped(study) for study in list_shipped_studies()))


def read_template(name: str) -> Protocol:
    """Read the protocol of a template.

    Raises:
        ProtocolError: if there is no such template.
    """
    for study in list_shipped_studies():
        if study.name == name:
            return study.read()
    return _decode_draft(name)


def make_study(request: NewStudyRequest, folder: Path, source: Path | None) -> Path:
    """Write a new study into a folder, and return its file.

    Args:
        request: the name of the study, and its template and language.
        folder: the folder of the protocols.
        source: the protocol of which this is a new version; None for a template.

    Raises:
        EditRefusedError: if there is a study of that name already, or no such template.
        OSError: if it cannot be written.
    """
    try:
        name = make_study_name(request.name)
        if source is not None:
            return _copy_version(source, name)
        for study in list_shipped_studies():
            if study.name == request.template:
                return _copy_shipped(study, name, folder)
        templates = () if request.template in _WITHOUT_TEMPLATE else (request.template,)
        _require_new(folder / f"{name}.toml")
        if request.template == _NOTEBOOK:
            _require_new(folder / f"{name}.ipynb")
            _write_file(folder / f"{name}.ipynb", format_notebook(name).encode())
        return write_draft(ProtocolDraft(name, templates=templates, language=request.language), folder)
    except EditRefusedError:
        raise
    except MinihumanError as error:
        raise EditRefusedError(EditRefusal("not_valid", str(error))) from error


def _copy_version(source: Path, name: str) -> Path:
    """Copy a protocol within its folder under another name, and return the new file.

    The last number of the study's version is one higher in the copy.

    Raises:
        EditRefusedError: if there is a study of that name already.
    """
    path = source.with_name(f"{name}.toml")
    _require_new(path)
    document = TomlDocument.parse(source.read_bytes().decode()).set(("study", "name"), name)
    version = _LAST_NUMBER.sub(lambda number: str(int(number[0]) + 1), str(document.find(("study", "version"))))
    _write_file(path, document.set(("study", "version"), version).text.encode())
    return path


def _copy_shipped(study: ShippedStudy, name: str, folder: Path) -> Path:
    """Copy a protocol of the package and its files under another name, and return the new protocol's file.

    A protocol that has files is copied with them into a new folder inside ``folder``, else directly into ``folder``.
    Copied Python files are not trusted; users may trust them after reading them.

    Raises:
        EditRefusedError: if there is a study of that name already.
    """
    files = study.read_files()
    if files:
        folder = folder / name
    path = folder / f"{name}.toml"
    _require_new(path)
    for file_name, content in files.items():
        _write_file(folder / file_name, content)
    _write_file(path, TomlDocument.parse(study.path.read_bytes().decode()).set(("study", "name"), name).text.encode())
    return path


def _write_file(path: Path, content: bytes) -> None:
    with replace_durably(path, mode=0o644) as file:
        file.write(content)


def _require_new(path: Path) -> None:
    if path.exists():
        raise EditRefusedError(EditRefusal("exists", f"there is a study {path.name} already; choose another name"))


@cache
def _decode_draft(name: str) -> Protocol:
    """Return the protocol of the template ``name``, one that is written from answers, with the usual answers.

    Raises:
        ProtocolError: if there is no such template.
    """
    templates = () if name in _WITHOUT_TEMPLATE else (name,)
    return decode_protocol(ProtocolDraft("my-study", templates=templates).toml().encode())


def _describe_draft(name: str, summary: str) -> Template:
    """Describe a template whose protocol is written from a user's answers, for the list of templates."""
    protocol = _decode_draft(name)
    title = name.replace("-", " ")
    topics = _list_topics(protocol)
    if name == _NOTEBOOK:
        topics.append(_NOTEBOOK)
    return Template(name, title, summary, "en", _estimate_minutes(protocol), [], "start", "", topics)


def _describe_shipped(study: ShippedStudy) -> Template:
    """Describe a template that is a protocol file of the package, for the list of templates."""
    protocol = study.read()
    title = protocol.about.title or protocol.study.name.replace("-", " ")
    return Template(
        study.name,
        title,
        study.summary,
        protocol.study.language,
        _estimate_minutes(protocol),
        list(study.read_files()),
        "trials" if study.name.startswith("trials/") else "example",
        _load_citations().get(study.name, ""),
        _list_topics(protocol),
    )


@cache
def _load_citations() -> dict[str, str]:
    return tomllib.loads(Path(__file__).with_name("citations.toml").read_text(encoding="utf-8"))


def _has_trials(block: BlockSpec) -> bool:
    kind = find_installed_kind(block.kind)
    return kind is not None and kind.has_trials


def _list_topics(protocol: Protocol) -> list[str]:
    """Return the topics of a study's card, by which users find a template: "team", "adaptive", "two days"."""
    groups = [group.name for group in protocol.groups]
    blocks = [protocol.block_for(block.name, group) for block in protocol.blocks for group in groups]
    teams = [block.team for block in blocks if block.team]
    have_trials = [_has_trials(block) for block in blocks]
    topics = {
        "trials": any(have_trials),
        "grid": any(
            not is_first_person(block.world) and not has_trials
            for block, has_trials in zip(blocks, have_trials, strict=True)
        ),
        "first person": any(is_first_person(block.world) for block in blocks),
        "team": bool(teams),
        "agent": any(block.agent for block in blocks) or any(len(team.persons) < len(team.seats) for team in teams),
        "several groups": len(protocol.groups) > 1,
        "two days": len(protocol.sessions) > 1,
        "online": bool(protocol.web.recruitment_platforms or protocol.web.open_access),
        "adaptive": any(block.design for block in blocks) or protocol.allocation.design is not None,
        "own Python": any(":" in block.world for block in blocks),
    }
    return [topic for topic, applies in topics.items() if applies]


def _estimate_minutes(protocol: Protocol) -> tuple[float, float] | None:
    """Return the lower and the upper estimate of the longest session's minutes; None if there is no estimate."""
    minutes = [(duration.least_min, duration.most_min) for duration in estimate_durations(protocol)]
    return max(minutes, key=lambda pair: pair[1], default=None)
