"""Draw what new readers judge: lines of help, error messages and the list of files, by a seed.

python analysis/readers/draw.py FOLDER --seed 1

It writes `help.txt` and `errors.txt` (40 numbered lines each), `files.txt` (`git ls-files` of the package) and
`questions.txt` (24 questions about where something is done). A reader gets one of the prompts of `README.md` beside
here with one of the files, and nothing else.
"""

import argparse
import ast
import random
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click

import minihuman
from minihuman.cli.command_line import make_command_line

PACKAGE = Path(minihuman.__file__).parent
LINES = 40
QUESTIONS = (  # twelve on the app and twelve on the worlds and agents, as a first review asked them
    "the moment of a key press in a desktop window is stamped",
    "the moment of a key press in a browser page is stamped",
    "an entry is written into the enrolment log",
    "SIGTERM is handled while a session runs at the desk",
    "the reaction time of a step is computed",
    "a page of text becomes pixels",
    "it is decided whether an episode is included in the statistics",
    "a new kind of question would be added",
    "a new exporter would be added, or an existing one is found",
    "a new kind of window would be added",
    "a new recording device would be added",
    "a new language of the interface would be added",
    "the rule for opening and closing a door in the grid",
    "the colour of the sky is drawn in first person",
    "the random generator that draws a grid's layout",
    "the reward for success in a grid world is computed",
    "the step limit of an episode is decided",
    "an observation wrapper of grid worlds would be added",
    "a new kind of object in grid worlds would be added",
    "a 3D mesh is read from a file",
    "what a learner (an algorithm that learns from a person) must implement",
    "what a simulated participant must implement",
    "how far one step forward goes in a first-person world",
    "it is decided that a 'go to' instruction is fulfilled",
)


def help_lines() -> Iterator[str]:
    """Yield each command's summary and each parameter's help, with the command it belongs to."""
    yield from _help_of(make_command_line(), "minihuman")


def _help_of(command: click.Command, path: str) -> Iterator[str]:
    context = click.Context(command, info_name=path)
    for paragraph in (command.help or "").split("\n\n"):
        line = " ".join(paragraph.split())
        if line and not line.lstrip("\b ").startswith("Example:"):
            yield f"{path}: {line}"
    for parameter in command.params:
        if words := getattr(parameter, "help", None):
            yield f"{path} {max(parameter.opts, key=len)}: {words}"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _help_of(inner, f"{path} {name}")


def error_lines() -> Iterator[str]:
    """Yield the message of each `raise ...Error(...)`; what is filled in stands in braces."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                name = ast.unparse(node.exc.func)
                words = _words(node.exc.args[0])
                if (
                    name.endswith("Error")
                    and name != "AssertionError"
                    and len(re.sub(r"\{[^}]*\}", "", words).split()) >= 3
                ):
                    yield f"{name.rpartition('.')[2]}: {words}"


def _words(node: ast.expr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "{" + _name(part) + "}" for part in node.values
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _words(node.left) + _words(node.right)
    return ""


def _name(part: ast.expr) -> str:
    assert isinstance(part, ast.FormattedValue)
    return ast.unparse(part.value)


def draw(folder: Path, seed: int) -> None:
    """Write the material of one round of readers."""
    folder.mkdir(parents=True, exist_ok=True)
    chance = random.Random(seed)
    for name, lines in (("help.txt", help_lines()), ("errors.txt", error_lines())):
        drawn = chance.sample(sorted(set(lines)), LINES)
        text = "\n".join(f"{number}. {line}" for number, line in enumerate(drawn, 1))
        (folder / name).write_text(text + "\n", encoding="utf-8")
    files = subprocess.run(
        ["git", "ls-files", "minihuman"], capture_output=True, text=True, check=True, cwd=PACKAGE.parent
    ).stdout
    (folder / "files.txt").write_text(files, encoding="utf-8")
    order = chance.sample(range(len(QUESTIONS)), len(QUESTIONS))
    asked = "\n".join(f"{number}. Which file: {QUESTIONS[place]}" for number, place in enumerate(order, 1))
    (folder / "questions.txt").write_text(asked + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    draw(given.folder, given.seed)
