"""Pages of the site from files above the docs' folder, and the links to such files.

The protocol reference and the changelog are read where they are. A link to any other file of the repository becomes its
name, because a site's pages cannot hold such files. The reference of names, commands, tables, topics and ports is
written from the package itself. Ports are read from their sources, never imported: a learner's imports PyTorch, which
the extra `docs` does not bring.
"""

import posixpath
import re
import sys
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import griffe  # what mkdocstrings reads the package with, and so always there with it
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import minihuman
from minihuman.cli.command_line import SECTIONS, make_command_line
from minihuman.dataset.table_catalogue import TABLES
from minihuman.experiment.machine.activity import list_built_in_kinds
from minihuman.log.codec import list_activity_topics
from minihuman.log.read.session_reader import read_log
from minihuman.log.topics import RARE_TOPICS, TOPICS
from minihuman.plugins import list_plugin_names

_ROOT = Path(__file__).parents[1]
_PAGES = {"protocols/README.md": "protocols.md", "CHANGELOG.md": "changelog.md"}
_MOVED = {  # an address that a page had, and where its text is now
    "desk": "tutorial-desk.html#the-start-page",
    "designs": "trials.html#adapt-to-the-participant",
    "first-study": "tutorial-first.html",
    "from-minigrid": "environments.html#coming-from-minigrid-or-miniworld",
    "gallery-first-person": "play.html#first-person-worlds",
    "gallery-grid": "play.html#grid-worlds",
    "gallery-levels": "play.html#babyai-levels",
    "instructions": "grid-worlds.html#babyai-levels",
    "kubernetes": "web.html#kubernetes",
    "log-topics": "log-format.html#topics-and-their-fields",
    "notebook": "api.html#a-study-in-a-notebook",
    "outcomes": "environments.html#what-an-end-means",
    "pages": "play.html#worlds-in-your-own-pages",
    "ports": "extending.html#ports",
    "simulated-people": "models.html#simulated-participants",
    "team-worlds": "teams.html#worlds-with-several-bodies",
    "trust": "protocols.html#protocols-from-others",
    "tutorial-agent": "teaching.html#a-study-with-an-agent",
    "upgrading": "install.html#upgrade",
    "windows": "devices.html",
}
_MARKER = re.compile(r"^<!-- ([./\w]+) -->$", re.MULTILINE)  # where a page's generated part stands
_LABEL = re.compile(r"^(```\w+) [\w-]+$", re.MULTILINE)  # by which tests know a block of code
_HEADING = re.compile(r"^##", re.MULTILINE)
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that are files above the docs' folder."""
    for source, page in _PAGES.items():
        text = _resolve_links((_ROOT / source).read_text(encoding="utf-8"), (_ROOT / source).parent, page)
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Resolve links that leave the docs' folder, and write the generated part of a reference page."""
    written = {
        "api.md": list_exports,
        "commands.md": list_commands,
        "tables.md": list_tables,
        "log-format.md": partial(_write_section, list_topics),
        "extending.md": partial(_write_section, list_ports),
        "install.md": list_frozen_logs,
    }
    if write := written.get(page.file.src_uri):
        markdown = _MARKER.sub(lambda marker: write(marker[1]), markdown)
    markdown = _LABEL.sub(r"\1", markdown)
    return _resolve_links(markdown, (_ROOT / "docs" / page.file.src_uri).parent, page.file.src_uri)


def on_post_page(output: str, **_: Any) -> str:
    """Mend a search dialog without a name, inputs that Tab should not reach, and galleries that load at once."""
    dialog = 'data-md-component="search" role="dialog"'
    hidden = '<input class="md-option"'
    picture = ' src="gallery-'
    output = output.replace(dialog, f'{dialog} aria-label="Search"').replace(hidden, f'{hidden} tabindex="-1"')
    return output.replace(picture, f' loading="lazy"{picture}')


def _write_section(write: Callable[[str], str], marker: str) -> str:
    """Write a generated part that is one section of its page: its headings are a level lower."""
    return _HEADING.sub("###", write(marker))


def list_exports(package: str) -> str:
    """Write a reference entry for each name that a package exports."""
    modules = _read_exported_modules(package)
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
            f"| `{column.name}` | {column.kind} | {column.unit} | {column.meaning.replace('|', '&#124;')} |"
            for column in columns
        ]
        lines.append("")
    return "\n".join(lines)


def list_topics(_: str) -> str:
    """Write each topic's message with type and meaning of its fields, then the messages that others contain."""
    messages = _read_messages()
    lines: list[str] = []
    contents = dict(_TOPIC_ROW.findall((_ROOT / "docs/log-format.md").read_text(encoding="utf-8")))
    for topic in (*TOPICS, *RARE_TOPICS, *list_activity_topics(list_built_in_kinds())):
        descriptor = topic.message.DESCRIPTOR
        lines += [f"## {topic.name}", "", f"`{descriptor.full_name}`: {contents[topic.name]}.", ""]
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
    for path in sorted((Path(minihuman.__file__).parent / "log/proto").glob("*.proto"), reverse=True):
        for name, body in _MESSAGE.findall(path.read_text(encoding="utf-8")):
            messages[name] = _FIELD.findall(body)
            if undescribed := [field for _, field, meaning in messages[name] if not meaning]:
                raise PluginError(f"{path}: {name}.{undescribed[0]} has no comment; write what it holds after `//`")
    return messages


_TOPIC_ROW = re.compile(r"^\| `(/\S+)` \| `\S+` \| (.+) \|$", re.MULTILINE)
_MESSAGE = re.compile(r"^message (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^\s+((?:optional |repeated )?[\w.]+) (\w+) = \d+;(?:  // (.*))?$", re.MULTILINE)


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
    modules = _read_exported_modules("minihuman.ext")
    lines: list[str] = []
    for group, (registered, name, check) in PORTS.items():
        port = _read_class(modules[name], name)
        built_in = list_plugin_names(f"minihuman.{group}", built_in=True)
        where = f"the entry-point group `minihuman.{group}`" if built_in else "its Gymnasium id, `module:Id-v0`"
        lines += [f"## {group}", "", f"Registered is {registered} [`{name}`](api.md#{port.path}),"]
        lines += [f"found by {where}. `minihuman.testing.{check}` tests it."]
        if built_in:
            lines += [f"Built in: {', '.join(f'`{plugin}`' for plugin in built_in)}."]
        lines += ["", f"`{name}`: {_read_summary(port, separator=chr(10))}", ""]
        if methods := _list_methods(port):
            lines += ["| method | required | what it does |", "|---|---|---|", *methods, ""]
    return "\n".join(lines)


def _read_exported_modules(package: str) -> dict[str, str]:
    """Read in which module each name is that a package exports."""
    modules: dict[str, str] = import_module(package)._MODULES
    return modules


@cache
def _read_package() -> griffe.GriffeLoader:
    """Read the package's sources once: 3 CPU-seconds."""
    loader = griffe.GriffeLoader(search_paths=[_ROOT])
    loader.load("minihuman")
    return loader


def _read_class(module: str, name: str) -> griffe.Class:
    """Read a class and the classes that it inherits from, without importing their modules."""
    port = _read_package().modules_collection[f"{module}.{name}"]
    assert isinstance(port, griffe.Class), f"{module}.{name} is not a class"
    return port


def _list_methods(port: griffe.Class) -> list[str]:
    rows = []
    for name, member in sorted(port.all_members.items()):
        if name.startswith("_") or not (member.is_function or "property" in member.labels):
            continue
        required = "yes" if "abstractmethod" in member.labels else "no"
        shown = f"{name}()" if member.is_function else name
        rows.append(f"| `{shown}` | {required} | {_read_summary(member).replace('|', '&#124;')} |")
    return rows


def _read_summary(documented: griffe.Object | griffe.Alias, separator: str = " ") -> str:
    """Read the first paragraph of a docstring; its lines end with the separator."""
    text = documented.docstring.value if documented.docstring else ""
    return text.partition("\n\n")[0].replace("\n", separator)


def _resolve_links(markdown: str, folder: Path, page: str) -> str:
    """Resolve the links of a text that lies in a folder of the repository and becomes this page of the site."""

    def resolve(link: re.Match[str]) -> str:
        text = link[1]
        target = link[2]
        anchor = link[3] or ""
        file = (folder / target).resolve()
        if "://" in target or not file.is_relative_to(_ROOT) or not file.exists():
            return link[0]
        name = file.relative_to(_ROOT).as_posix()
        if name in _PAGES or (name.startswith("docs/") and file.suffix != ".py"):  # no site has Python files
            linked = _PAGES.get(name, name.removeprefix("docs/"))
            return f"[{text}]({posixpath.relpath(linked, posixpath.dirname(page))}{anchor})"
        if name.endswith(text.strip("`")):
            return f"`{name}`"
        return text if name in text else f"{text} (`{name}`)"

    return _LINK.sub(resolve, markdown)


def on_post_build(*, config: MkDocsConfig) -> None:
    """Put the live gallery and the level editor beside the pages, and a page that leads on where one was before."""
    for name, address in _MOVED.items():
        page = f'<meta http-equiv="refresh" content="0; url={address}"><a href="{address}">This page has moved.</a>'
        (Path(config.site_dir) / f"{name}.html").write_text(f"<!doctype html><title>Moved</title>{page}\n", "utf-8")
    sys.path.insert(0, str(_ROOT / "docs"))
    try:
        write_gallery = import_module("gallery_live").write_gallery
    finally:
        sys.path.pop(0)
    write_gallery(Path(config.site_dir) / "play")
