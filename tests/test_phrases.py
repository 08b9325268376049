"""Phrases: none that was replaced by the trade's words comes back into help, docs or error messages."""

import ast
import csv
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import minihuman
from minihuman.cli.command_line import make_command_line
from tests.sources import parse_source

ROOT = Path(__file__).parents[1]
PACKAGE = Path(minihuman.__file__).parent
with Path(__file__).with_name("phrases.tsv").open(encoding="utf-8", newline="") as file:
    PHRASES = list(csv.DictReader(file, delimiter="\t"))


def _commands(command: click.Command, path: str = "minihuman") -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            if inner := command.get_command(context, name):
                yield from _commands(inner, f"{path} {name}")


def _help() -> Iterator[tuple[str, str]]:
    for path, command in _commands(make_command_line()):
        yield f"{path} --help", command.get_help(click.Context(command, info_name=path))


def _docs() -> Iterator[tuple[str, str]]:
    for path in (ROOT / "README.md", ROOT / "protocols" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def _errors() -> Iterator[tuple[str, str]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(parse_source(path)):
            raised = isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
            if raised or (isinstance(node, ast.Yield) and path.is_relative_to(PACKAGE / "experiment" / "protocol")):
                literals = [one.value for one in ast.walk(node) if isinstance(one, ast.Constant)]
                words = "{}".join(one for one in literals if isinstance(one, str))
                yield f"{path.relative_to(PACKAGE)}:{node.lineno}", words


@pytest.mark.parametrize(("scope", "texts"), [("help", _help), ("docs", _docs), ("errors", _errors)])
def test_no_replaced_phrase_comes_back(scope, texts):
    found = []
    for place, text in texts():
        words = " ".join(text.split())
        for row in PHRASES:
            excepted = row["exceptions"].partition(":")[0].split()
            if scope in row["scope"].split() and place.partition(":")[0] not in excepted:
                hits = re.finditer(rf"\b{re.escape(row['old'])}\b", words, re.IGNORECASE)
                found += [f"{place}: {words[max(hit.start() - 40, 0) : hit.end() + 40]!r}" for hit in hits]
    assert found == []


def test_every_exception_has_a_reason_and_is_needed():
    docs = dict(_docs())
    for row in PHRASES:
        places, _, reason = row["exceptions"].partition(": ")
        for place in places.split():
            assert reason
            assert row["old"].lower() in docs[place].lower()


_OUTPUTS = {"--pictures", "--preregistration"}  # `check` writes both beside its plan, so each has a name of its own
_WORDS = {
    "STUDY",
    "STUDY...",
    "PROTOCOL...",
    "LOG",
    "LOG...",
    "PROTOCOL",
    "FORMAT",
    "POLICY",
    "CODE",
    "SQL",
    "WORLD",
    "WORLD...",
    "DATA...",
    "FOLDER",
    "OUT",
}


def test_one_argument_has_one_word_in_all_commands():
    for path, command in _commands(make_command_line()):
        for one in command.params:
            if isinstance(one, click.Argument):
                word = one.metavar if one.required else one.metavar.removeprefix("[").removesuffix("]")
                assert word in _WORDS, f"{path} {one.metavar}"


def test_options_of_one_name_have_one_kind_and_output_is_out():
    kinds: dict[str, set[str]] = {}
    for path, command in _commands(make_command_line()):
        for one in command.params:
            if not isinstance(one, click.Option):
                continue
            name = one.opts[0]
            if name in ("--out", "--seed", "--json", "--data", "--study", "--player"):
                kinds.setdefault(name, set()).add(f"{one.type.name} {one.is_flag} {one.multiple}")
            if re.match(r"(Write|Draw|Save)\b.*\b(to|into) this", one.help or "") and name not in _OUTPUTS:
                assert name == "--out", f"{path} {name}"
    assert {name: found for name, found in kinds.items() if len(found) > 1} == {}


def test_a_help_text_is_a_sentence():
    for path, command in _commands(make_command_line()):
        for one in command.params:
            if isinstance(one, click.Option):
                assert re.match(r"[A-Z].*\.$", one.help or "", re.DOTALL), f"{path} {one.opts[0]}: {one.help}"


def test_what_prints_a_table_prints_json_too():
    tables = ["status", "info", "query", "worlds", "plugins", "doctor", "check", "verify", "power", "fit", "payments"]
    commands = dict(_commands(make_command_line()))
    lacks = [name for name in tables if not any("--json" in one.opts for one in commands[f"minihuman {name}"].params)]
    assert lacks == []
