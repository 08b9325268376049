"""The tutorials, done as they are written: their files saved, their commands run in order, what they print compared."""

import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
import urllib.request
from pathlib import Path

import click
import pytest

from minihuman.cli.command_line import make_command_line
from minihuman.experiment.protocol.protocol import decode_protocol
from tests.counts import PATIENCE_S
from tests.programs import running

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^( *)```(\w+)[^\n]*\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
PAGES = sorted([*DOCS.glob("*.md"), DOCS.parent / "README.md", DOCS.parent / "protocols/README.md"])
STUDY = """
[study]
name = "page"
version = "1"
seed = 1
participants = 4
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
"""
WEB = "\n[[pages]]\n"  # above which the second tutorial's lines go


def blocks(page: Path) -> list[tuple[str, str]]:
    """A page's blocks of code: language and text."""
    return [(found[2], found[3]) for found in BLOCK.finditer(page.read_text(encoding="utf-8"))]


def join_lines(block: str) -> list[str]:
    """The commands of a block, each in one line."""
    return block.replace("\\\n", "").splitlines()


def shell_commands(page: Path) -> list[str]:
    """Every command of minihuman on a page: in a block, indented as one, or named in a sentence."""
    text = page.read_text(encoding="utf-8")
    lines = [line for kind, block in blocks(page) if kind in ("sh", "bash") for line in join_lines(block)]
    lines += re.findall(r"^ {4}(minihuman .*)$", text, re.MULTILINE)
    lines += re.findall(r"`(minihuman [a-z]+ [^`]*)`", text)
    return [line for line in lines if line.startswith("minihuman ")]


def save_files(page: Path, folder: Path) -> None:
    """Save the protocols of a tutorial, under the names that it gives them."""
    tomls = [block for kind, block in blocks(page) if kind == "toml"]
    match page.stem:
        case "tutorial-desk":
            (folder / "three-rooms.toml").write_text(tomls[0])
        case "tutorial-home":
            study = next(block for kind, block in blocks(DOCS / "tutorial-desk.md") if kind == "toml")
            (folder / "three-rooms.toml").write_text(study.replace(WEB, f"\n{tomls[0]}{WEB}", 1))
        case "teaching":
            (folder / "helper.toml").write_text(tomls[0])
            head, _, rest = tomls[0].partition("[blocks.agent]")
            decode_protocol(f"{head}{tomls[1]}{rest[rest.index(chr(10) * 2) :]}".encode())


def serve(line: str, folder: Path, here: dict[str, str]) -> str:
    """What `minihuman serve` prints until all its links are there, as if on its usual port; then it is ended."""
    words = [sys.executable, "-m", *shlex.split(line), "--port", "0"]
    links = int(words[words.index("--links") + 1])
    with running(words, cwd=folder, env={**os.environ, **here}, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        printed = ""
        address = ""
        for each in server.stdout:
            printed += re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:8000", each)
            address = each.partition("#t=")[0]
            if printed.count("#t=") == links:
                break
        with urllib.request.urlopen(address, timeout=PATIENCE_S) as page:  # from then on Ctrl-C ends it as it should
            assert b"<html" in page.read()
        server.send_signal(signal.SIGINT)
        printed += re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:8000", server.stdout.read())
    assert server.returncode == 0, printed
    assert len(set(re.findall("#t=.+", printed))) == links
    return printed


@pytest.mark.nightly(by_day=["tutorial-first"])
@pytest.mark.program
@pytest.mark.parametrize("name", ["tutorial-first", "tutorial-desk", "tutorial-home", "teaching"])
def test_a_tutorial_prints_what_it_says(name: str, tmp_path: Path) -> None:
    page = DOCS / f"{name}.md"
    save_files(page, tmp_path)
    here = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    said, compared = "", 0
    for kind, block in blocks(page):
        if kind == "sh":
            said = ""
            for line in join_lines(block):
                done = subprocess.run(
                    ["bash", "-c", line], cwd=tmp_path, env={**os.environ, **here}, capture_output=True, text=True
                )
                assert done.returncode == 0, (line, done.stderr)
                said += done.stdout + done.stderr
        elif kind == "bash":  # what waits for people: of it, only a server's links are compared
            said = serve(block, tmp_path, here) if re.fullmatch("minihuman serve [^>\n]+\n", block) else ""
        elif kind == "text" and said:
            printed = re.sub(r"127\.0\.0\.1:\d+", "127.0.0.1:8000", said).splitlines()
            for line in block.splitlines():
                pattern = re.compile(".*".join(map(re.escape, line.split("..."))))
                assert any(pattern.fullmatch(each) for each in printed), (line, said)
                compared += line in printed
    assert compared > 3


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS.parent)))
def test_every_command_of_a_page_is_one_that_the_command_line_takes(page: Path) -> None:
    """A sentence may name a command without its arguments; options that there are not are wrong there, too."""
    in_blocks = {line for kind, block in blocks(page) if kind in ("sh", "bash") for line in join_lines(block)}
    for line in shell_commands(page):
        words = shlex.split(re.split(r" (?:#|\||&&|>) ?", line)[0], comments=True)[1:]
        group: click.Command | None = make_command_line()
        context = click.Context(group)  # type: ignore[arg-type]
        while isinstance(group, click.Group) and words and not words[0].startswith("-"):
            group = group.get_command(context, words.pop(0))
        assert group is not None, f"{page.name}: {line}"
        try:
            group.make_context("minihuman", list(words))
        except click.exceptions.Exit:
            continue  # --help, --version
        except click.MissingParameter as error:
            if line in in_blocks:
                pytest.fail(f"{page.name}: {line}: {error.format_message()}")
        except click.UsageError as error:
            pytest.fail(f"{page.name}: {line}: {error.format_message()}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS.parent)))
def test_every_block_of_toml_is_toml_and_every_block_of_python_is_python(page: Path) -> None:
    for kind, block in blocks(page):
        if kind == "toml":
            tomllib.loads(block)
        elif kind == "python":
            compile(block, page.name, "exec")


def test_no_page_shows_a_diagram_as_its_source() -> None:
    assert [page.name for page in PAGES if re.search(r"```(mermaid|dot|plantuml)", page.read_text())] == []
    hooks = (DOCS.parent / "mkdocs.yml").read_text()
    assert "mermaid" not in hooks


def test_the_drawn_level_of_the_play_page_can_be_trained_on() -> None:
    python = next(block for kind, block in blocks(DOCS / "play.md") if kind == "python")
    found: dict[str, object] = {}
    exec(compile(python, "play.md", "exec"), found)
    level = next(block for kind, block in blocks(DOCS / "play.md") if kind == "toml")
    study = f"{STUDY}[[groups]]\nname = 'all'\nblocks = ['my-level']\n{level}episodes = 1\n"
    assert decode_protocol(study.encode()).blocks[0].name == "my-level"
    assert found["env"]
