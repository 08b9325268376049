"""Pages of the site from files above the docs' folder, and the links to such files.

The protocol reference and the changelog are read where they are. A link to any other file of the repository becomes its
name, because a site's pages cannot hold such files. The reference of names, commands, tables, topics and ports is
written from the package itself.
"""

import inspect
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from minihuman import ext
from minihuman.cli.command_line import SECTIONS, make_command_line
from minihuman.dataset.table_catalogue import TABLES
from minihuman.experiment.machine.activity import list_built_in_kinds
from minihuman.log.codec import list_activity_topics
from minihuman.log.read.session_reader import read_log
from minihuman.log.topics import RARE_TOPICS, TOPICS
from minihuman.plugins import list_plugin_names

_ROOT = Path(__file__).parents[1]
_PAGES = {"protocols/README.md": "protocols.md", "CHANGELOG.md": "changelog.md"}
_MARKER = re.compile(r"^<!-- ([./\w]+) -->$", re.MULTILINE)  # where a page's generated part stands
_LABEL = re.compile(r"^(```\w+) [\w-]+$", re.MULTILINE)  # by which tests know a block of code
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that are files above the docs' folder."""
    for source, page in _PAGES.items():
        text = _resolve_links((_ROOT / source).read_text(encoding="utf-8"), (_ROOT / source).parent)
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Resolve links that leave the docs' folder, and write the generated part of a reference page."""
    written = {
        "api.md": list_exports,
        "commands.md": list_commands,
        "tables.md": list_tables,
        "log-topics.md": list_topics,
        "ports.md": list_ports,
        "upgrading.md": list_frozen_logs,
    }
    if write := written.get(page.file.src_uri):
        markdown = _MARKER.sub(lambda found: write(found[1]), markdown)
    markdown = _LABEL.sub(r"\1", markdown)
    return _resolve_links(markdown, _ROOT / "docs")


def on_post_page(output: str, **_: Any) -> str:
    """Mend two things that the theme leaves: a search dialog without a name, and hidden inputs that Tab reaches."""
    dialog, hidden = 'data-md-component="search" role="dialog"', '<input class="md-option"'
    return output.replace(dialog, f'{dialog} aria-label="Search"').replace(hidden, f'{hidden} tabindex="-1"')


def list_exports(package: str) -> str:
    """Write a reference entry for each name that a package exports."""
    modules: dict[str, str] = import_module(package)._MODULES
    return "\n\n".join(f"::: {module}.{name}" for name, module in modules.items())


def list_commands(_: str) -> str:
    """Write the help of each command, by section."""
    group = make_command_line()
    lines: list[str] = []
    for section, names in SECTIONS.items():
        lines += [f"## {section.capitalize()}", ""]
        for name in names:
            lines += _describe_command(group.get_command(click.Context(group), name), f"minihuman {name}", "###")
    return "\n".join(lines)


def _describe_command(command: click.Command | None, path: str, heading: str) -> list[str]:
    assert command is not None
    context = click.Context(command, info_name=path, max_content_width=100, terminal_width=100)
    lines = [f"{heading} {path}", "", "```text", command.get_help(context), "```", ""]
    for name, inner in command.commands.items() if isinstance(command, click.Group) else ():
        lines += _describe_command(inner, f"{path} {name}", f"{heading}#")
    return lines


def list_tables(_: str) -> str:
    """Write each table's columns with type, unit and meaning."""
    lines: list[str] = []
    for name, columns in TABLES.items():
        lines += [f"## {name}", "", "| column | type | unit | meaning |", "|---|---|---|---|"]
        lines += [
            f"| `{one.name}` | {one.kind} | {one.unit} | {one.meaning.replace('|', '&#124;')} |" for one in columns
        ]
        lines.append("")
    return "\n".join(lines)


def list_topics(_: str) -> str:
    """Write each topic's message with type and meaning of its fields, then the messages that others contain."""
    messages = _read_messages()
    lines: list[str] = []
    held = dict(_TOPIC_ROW.findall((_ROOT / "docs/log-format.md").read_text(encoding="utf-8")))
    for topic in (*TOPICS, *RARE_TOPICS, *list_activity_topics(list_built_in_kinds())):
        descriptor = topic.message.DESCRIPTOR
        lines += [f"## {topic.name}", "", f"`{descriptor.full_name}`: {held[topic.name]}.", ""]
        if topic.is_preview:
            names = ", ".join(f"`{field.name}`" for field in descriptor.fields)
            lines += [f"A preview for viewers, whose fields are Foxglove's: {names}.", ""]
        else:
            lines += _list_fields(messages.pop(descriptor.name))
    lines += ["## Messages within messages", ""]
    for name, fields in messages.items():
        lines += [f"### {name}", "", *_list_fields(fields)]
    return "\n".join(lines)


def _list_fields(fields: list[tuple[str, str, str]]) -> list[str]:
    rows = [f"| `{name}` | {kind} | {meaning} |" for kind, name, meaning in fields]
    return ["| field | type | meaning |", "|---|---|---|", *rows, ""]


def _read_messages() -> dict[str, list[tuple[str, str, str]]]:
    """Read each message's fields from the .proto files: type, name and comment."""
    messages: dict[str, list[tuple[str, str, str]]] = {}
    for path in sorted((_ROOT / "minihuman/log/proto").glob("*.proto"), reverse=True):
        for name, body in _MESSAGE.findall(path.read_text(encoding="utf-8")):
            messages[name] = _FIELD.findall(body)
    return messages


_TOPIC_ROW = re.compile(r"^\| `(/\S+)` \| `\S+` \| (.+) \|$", re.MULTILINE)
_MESSAGE = re.compile(r"^message (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^\s+((?:optional |repeated )?[\w.]+) (\w+) = \d+;  // (.*)$", re.MULTILINE)


def list_frozen_logs(folder: str) -> str:
    """Write what each frozen study holds: format, sessions, episodes and steps."""
    lines = ["| study | format | logs | episodes | steps |", "|---|---|---|---|---|"]
    for study in sorted(path for path in (_ROOT / folder).glob("v[0-9]/*") if path.is_dir()):
        logs = [read_log(path) for path in sorted(study.rglob("ses-*")) if path.is_dir()]
        episodes = [episode for log in logs for episode in log.episodes]
        steps = sum(len(episode.actions) for episode in episodes)
        lines += [f"| `{study.name}` | {study.parent.name[1:]} | {len(logs)} | {len(episodes)} | {steps} |"]
    return "\n".join(lines)


PORTS = {  # what a plug-in of each group registers, the port that this implements, and the test that holds it to that
    "worlds": ("a `gymnasium.Env` that is a", "NativeWorld", "check_world"),
    "windows": ("a", "Window", "check_window"),
    "activities": ("an `ActivityKind`, which names an", "Activity", "check_activity"),
    "questions": ("a `QuestionKind`, which names an", "AnswerDraft", "check_question"),
    "agents": ("a", "BaseAgent", "check_agent"),
    "players": ("a", "SimulatedParticipant", "check_participant"),
    "learners": ("a", "Learner", "check_learner"),
    "designs": ("an adaptive", "Design", "check_design"),
    "devices": ("a", "Device", "check_device"),
    "exporters": ("a function of a source, a selection and a folder that returns an", "ExportResult", "check_exporter"),
}


def list_ports(_: str) -> str:
    """Write each kind of plug-in: its port, methods, contract test, and the built-in ones."""
    lines: list[str] = []
    for group, (registered, name, check) in PORTS.items():
        port = getattr(ext, name)
        built_in = list_plugin_names(f"minihuman.{group}", built_in=True)
        where = f"the entry-point group `minihuman.{group}`" if built_in else "its Gymnasium id, `module:Id-v0`"
        lines += [f"## {group}", "", f"Registered is {registered} [`{name}`](api.md#{port.__module__}.{name}),"]
        lines += [f"found by {where}. `minihuman.testing.{check}` tests it."]
        lines += [f"Built in: {', '.join(f'`{one}`' for one in built_in)}."] if built_in else []
        lines += ["", f"`{name}`: {inspect.cleandoc(port.__doc__).partition(chr(10) * 2)[0]}", ""]
        if methods := _list_methods(port):
            lines += ["| method | required | what it does |", "|---|---|---|", *methods, ""]
    return "\n".join(lines)


def _list_methods(port: type) -> list[str]:
    abstract = getattr(port, "__abstractmethods__", frozenset())
    rows = []
    for name, what in inspect.getmembers(port, lambda one: inspect.isfunction(one) or isinstance(one, property)):
        function = what.fget if isinstance(what, property) else what
        if not name.startswith("_") and function.__module__.startswith("minihuman.") and function.__name__ == name:
            said = inspect.cleandoc(function.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
            shown = name if isinstance(what, property) else f"{name}()"
            rows.append(f"| `{shown}` | {'yes' if name in abstract else 'no'} | {said.replace('|', '&#124;')} |")
    return rows


def _resolve_links(markdown: str, folder: Path) -> str:
    def resolve(found: re.Match[str]) -> str:
        text, target, anchor = found[1], found[2], found[3] or ""
        file = (folder / target).resolve()
        if "://" in target or not file.is_relative_to(_ROOT) or not file.exists():
            return found[0]
        name = file.relative_to(_ROOT).as_posix()
        if name in _PAGES:
            return f"[{text}]({_PAGES[name]}{anchor})"
        if name.startswith("docs/"):
            return f"[{text}]({name.removeprefix('docs/')}{anchor})"
        if name.endswith(text.strip("`")):
            return f"`{name}`"
        return text if name in text else f"{text} (`{name}`)"

    return _LINK.sub(resolve, markdown)


def on_post_build(*, config: MkDocsConfig) -> None:
    """Put the live gallery and the level editor beside the pages: `play/` is files alone."""
    sys.path.insert(0, str(_ROOT / "docs"))
    try:
        write_gallery = import_module("gallery_live").write_gallery
    finally:
        sys.path.pop(0)
    write_gallery(Path(config.site_dir) / "play")
