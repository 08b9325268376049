"""A protocol's text under edits: what changes, what stays, and what is refused."""

import random
import re
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from minihuman.builder.description import list_parts
from minihuman.builder.document import MISSING, NotEditableError, TomlDocument, is_same_value

ROOT = Path(__file__).parents[2]
PROTOCOLS = sorted(
    path
    for folder in ("protocols", "analysis", "docs", "tests/recompute")
    for path in (ROOT / folder).rglob("*.toml")
    if re.search(rb"^(\[study\]|study = )", path.read_bytes(), re.MULTILINE)
)

TEXT = """\
# A study.

[study]
name = 'rooms'   # of the folder
seed = 1_000
min_rest_s = 1.50
consent = \"\"\"
You may "stop"
at any time.\"\"\"

# What is played

# the first
[[blocks]]
name = "grid"
actions = [
    "left", # turns
    "right",
    # and on
    "forward"
]
points = { goal = 10, per_step = -0.1 }
stimuli.file = "a.csv"
# commented = out

[blocks.group_overrides.shown]
show_keys = true

# the second
[[blocks]]
name = "hall"
episodes = 2

[web]
open_access = true
"""


def changed(edited: TomlDocument, text: str = TEXT) -> list[tuple[str, str]]:
    """Pair the lines that differ, for edits that keep the number of lines."""
    return [(old, new) for old, new in zip(text.split("\n"), edited.text.split("\n"), strict=True) if old != new]


@pytest.fixture
def document() -> TomlDocument:
    return TomlDocument.parse(TEXT)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        (("study", "name"), "halls", "name = 'halls'   # of the folder"),
        (("study", "name"), "it's", 'name = "it\'s"   # of the folder'),
        (("study", "seed"), 7, "seed = 7"),
        (("study", "min_rest_s"), 2, "min_rest_s = 2.0"),
        (("blocks", 0, "points", "goal"), 20, "points = { goal = 20, per_step = -0.1 }"),
        (("blocks", 0, "actions", 0), "up", '    "up", # turns'),
        (("blocks", 0, "stimuli", "file"), "b\\c.csv", 'stimuli.file = "b\\\\c.csv"'),
        (("blocks", 1, "name"), 'a "hall"\x07', 'name = "a \\"hall\\"\\u0007"'),
    ],
)
def test_a_new_value_takes_the_place_of_the_old_one_alone(
    document: TomlDocument, path: tuple[str | int, ...], value: object, line: str
) -> None:
    edited = document.set(path, value)
    assert [new for _, new in changed(edited)] == [line]
    assert edited.find(path) == value
    assert edited.set(path, document.find(path), document.literal(path)).text == TEXT


def test_the_same_value_changes_nothing_however_it_is_written(document: TomlDocument) -> None:
    assert document.set(("study", "min_rest_s"), 1.5) is document
    assert document.set(("study", "seed"), 1000) is document
    assert document.set(("study", "seed"), 1000.0) is document
    assert document.set(("web", "open_access"), 1).find(("web", "open_access")) == 1


def test_a_text_of_several_lines_stays_one(document: TomlDocument) -> None:
    edited = document.set(("study", "consent"), 'One \\ line\n"""and\nanother"')
    assert 'consent = """\nOne \\\\ line\n""\\"and\nanother\\""""\n\n# What is played' in edited.text


def test_a_field_is_added_below_those_of_its_table(document: TomlDocument) -> None:
    assert "episodes = 2\nshow_points = true\n\n[web]" in document.set(("blocks", 1, "show_points"), True).text
    assert (
        'stimuli.file = "a.csv"\nstimuli.order = "fixed"\n'
        in document.set(("blocks", 0, "stimuli", "order"), "fixed").text
    )
    assert "{ goal = 10, per_step = -0.1, timeout = 0 }" in document.set(("blocks", 0, "points", "timeout"), 0).text
    assert "episodes = 2\npoints = { goal = 5 }\n" in document.set(("blocks", 1, "points", "goal"), 5).text
    assert document.set(("about", "title"), "Rooms").text == f'{TEXT}\n[about]\ntitle = "Rooms"\n'
    shown = document.set(("blocks", 0, "group_overrides", "given"), {"show_keys": False}).text
    assert "show_keys = true\n\n[blocks.group_overrides.given]\nshow_keys = false\n\n# the second\n[[blocks]]" in shown


def test_a_list_keeps_the_comments_of_the_elements_that_stay(document: TomlDocument) -> None:
    edited = document.set(("blocks", 0, "actions"), ["left", "right", "up", "forward", "down"]).text
    assert '    "left", # turns\n    "right",\n    # and on\n    "up",\n    "forward",\n    "down"\n]' in edited
    assert '    "left", # turns\n    # and on\n    "forward"\n]' in document.remove(("blocks", 0, "actions", 1)).text


def test_an_element_moves_with_its_comments_and_its_tables(document: TomlDocument) -> None:
    moved = document.move(("blocks", 0), 1)
    assert moved.find(("blocks", 1, "group_overrides", "shown")) == {"show_keys": True}
    assert "# What is played\n\n# the second\n[[blocks]]" in moved.text
    assert "\n\n# the first\n[[blocks]]" in moved.text
    assert "# commented = out\n\n[blocks.group_overrides.shown]" in moved.text
    assert moved.move(("blocks", 1), 0).text == TEXT


def test_a_copy_is_written_as_the_original(document: TomlDocument) -> None:
    copied = document.duplicate(("blocks", 0))
    assert copied.text.count("# turns") == 2
    assert copied.find(("blocks", 1)) == document.find(("blocks", 0))
    assert copied.remove(("blocks", 1)).text == TEXT


def test_a_new_part_is_written_as_a_person_writes_it(document: TomlDocument) -> None:
    page = {"name": "how", "text": "Read.\nThen go.\n", "example": {"world": "w", "marks": {"agent": "you"}}}
    inserted = document.set(("pages",), [page])
    assert inserted.text == TEXT + (
        '\n[[pages]]\nname = "how"\ntext = """\nRead.\nThen go.\n"""\n'
        'example = { world = "w", marks = { agent = "you" } }\n'
    )
    block = {"name": "new", "episodes": 1}
    assert '\n# the second\n[[blocks]]\nname = "hall"' in document.insert(("blocks", 1), block).text
    assert (
        'show_keys = true\n\n[[blocks]]\nname = "new"\nepisodes = 1\n\n# the second'
        in document.insert(("blocks", 1), block).text
    )
    assert (
        'episodes = 2\n\n[[blocks]]\nname = "new"\nepisodes = 1\n\n[web]' in document.insert(("blocks", 2), block).text
    )


@pytest.mark.parametrize("change", [lambda text: text.replace("\n", "\r\n"), str.rstrip, lambda text: f"\ufeff{text}"])
def test_line_ends_a_missing_last_one_and_a_byte_order_mark_stay(change: Any) -> None:
    text = change(TEXT)
    document = TomlDocument.parse(text)
    for edited in (
        document.set(("web", "min_window_size_px"), [800, 600]).remove(("web", "min_window_size_px")),
        document.insert(("blocks", 2), {"name": "new"}).remove(("blocks", 2)),
        document.set(("about", "title"), "Rooms\nand halls").remove(("about",)),
        document.duplicate(("blocks", 1)).move(("blocks", 2), 0).move(("blocks", 0), 1).remove(("blocks", 2)),
    ):
        assert edited.text == text
    assert ("\r\n" in text) == ("\n" not in document.set(("about", "a"), "x\ny").text.replace("\r\n", ""))


def test_what_cannot_be_edited_is_refused_with_its_line() -> None:
    text = "[[a]]\nx = 1\n\n[b]\ny = 1\n\n[a.c]\nz = 1\n\n[[a]]\nx = 2\n"
    with pytest.raises(NotEditableError, match=r"line 1: the lines of a\[0\] are in 2 places"):
        TomlDocument.parse(text).move(("a", 1), 0)
    with pytest.raises(NotEditableError, match=r"there is no b\.q in the file") as error:
        TomlDocument.parse(text).remove(("b", "q"))
    assert (error.value.path, error.value.line) == (("b", "q"), 4)
    with pytest.raises(NotEditableError, match="integer of 64 bits"):
        TomlDocument.parse(text).set(("b", "y"), 2**64)
    with pytest.raises(NotEditableError, match="not a value that TOML has"):
        TomlDocument.parse(text).set(("b", "y"), None)
    with pytest.raises(NotEditableError, match="not valid TOML") as error:
        TomlDocument.parse("[b]\n\ny = \n")
    assert error.value.line == 3


def walk(value: object, path: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yield every value of a tree with its path."""
    if path:
        yield path, value
    if isinstance(value, dict):
        for key, member in value.items():
            yield from walk(member, (*path, key))
    elif isinstance(value, list):
        for number, element in enumerate(value):
            yield from walk(element, (*path, number))


@pytest.mark.parametrize("path", PROTOCOLS, ids=lambda path: path.stem)
def test_every_value_of_every_protocol_is_where_the_spans_say(path: Path) -> None:
    document = TomlDocument.parse(path.read_text(encoding="utf-8"))
    positions = document.spans.positions()
    for place, value in walk(document.tree):
        assert place in positions or value in ([], {})
        if literal := document.literal(place):
            assert tomllib.loads(f"value = {literal}")["value"] == value


def change_and_change_back(document: TomlDocument, choose: random.Random) -> TomlDocument | None:
    """Make an edit at random and its opposite; None where the edit does not apply."""
    path, value = choose.choice(list(walk(document.tree)))
    match choose.choice(("set", "move", "duplicate", "insert")), path[-1], value:
        case "set", _, str() | int() | float():
            other = choose.choice([value * 2, "other", 'a "quote"\n\\', 3, -0.25, [1], {"a": 1}])
            edited = document.set(path, other)
            assert is_same_value(edited.find(path), other)
            return edited.set(path, value, document.literal(path))
        case "move", int(), _:
            to = choose.randrange(len(document.find(path[:-1])))
            return document.move(path, to).move((*path[:-1], to), path[-1])
        case "duplicate", int() as number, _:
            return document.duplicate(path).remove((*path[:-1], number + 1))
        case "insert", _, dict():
            new = (*path, "a new field")
            assert document.find(new) is MISSING
            return document.set(new, choose.choice([1.5, "text\nlines", [1, 2], {"b": 1}])).remove(new)
    return None


@pytest.mark.parametrize("path", PROTOCOLS, ids=lambda path: path.stem)
def test_a_field_that_is_changed_and_changed_back_leaves_every_byte(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    document = TomlDocument.parse(text)
    choose = random.Random(path.stem)
    for _ in range(20):
        back = None
        with suppress(NotEditableError):  # of a part that is written in two places
            back = change_and_change_back(document, choose)
        if back is not None and "group_overrides" not in back.text.replace(text, ""):
            assert back.text == text


def test_a_part_is_listed_with_the_orders_that_name_it_and_no_others() -> None:
    tree = {
        "pages": [{"name": name} for name in ("main", "main_intro", "rest")],
        "orders": [{"name": "main", "parts": [["main_intro", "rest"], "after"]}, {"name": "late", "parts": ["main"]}],
    }
    orders_by_part = {part.name: part.used_in for part in list_parts(tree, None) if part.kind == "page"}
    assert orders_by_part == {"main": ["late"], "main_intro": ["main"], "rest": ["main"]}
