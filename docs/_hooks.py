"""Pages of the site from files above the docs' folder, and the links to such files.

The protocol reference and the changelog are read where they are. A link to any other file of the repository becomes its
name, because a site's pages cannot hold such files. The reference of
names, commands and tables is written from the package itself.
"""

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from minihuman.cli.command_line import SECTIONS, make_command_line
from minihuman.dataset.table_columns import TABLES

_ROOT = Path(__file__).parents[1]
_PAGES = {"protocols/README.md": "protocols.md", "CHANGELOG.md": "changelog.md"}
_MARKER = re.compile(r"^<!-- ([.\w]+) -->$", re.MULTILINE)  # where a page's generated part stands
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that are files above the docs' folder."""
    for source, page in _PAGES.items():
        text = _resolve_links((_ROOT / source).read_text(encoding="utf-8"), (_ROOT / source).parent)
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Resolve links that leave the docs' folder, and write the generated part of a reference page."""
    written = {"api.md": list_exports, "commands.md": list_commands, "tables.md": list_tables}
    if write := written.get(page.file.src_uri):
        markdown = _MARKER.sub(lambda found: write(found[1]), markdown)
    return _resolve_links(markdown, _ROOT / "docs")


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
        return text if name in text else f"{text} (`{name}`)"

    return _LINK.sub(resolve, markdown)
