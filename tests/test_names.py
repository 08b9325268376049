"""Names: one word for one thing, nouns for modules, and no word that was replaced comes back."""

import ast
import csv
from collections import defaultdict
from pathlib import Path

import minihuman
from tests.sources import parse_source

PACKAGE = Path(minihuman.__file__).parent
TABLE = Path(__file__).with_name("vocabulary.tsv")
NOT_NOUNS = {
    "told",
    "said",
    "asked",
    "around",
    "bare",
    "again",
    "made",
    "chosen",
    "carried",
    "taught",
    "kept",
    "whole",
    "own",
    "waiting",
    "shipped",
    "opened",
    "given",
    "shown",
    "found",
    "left",
    "counted",
    "drawn",
    "planned",
    "undrawn",
    "compared",
    "measured",
    "recorded",
    "things",
}
SAME_CLASS = {
    "PutNext": "a first-person world and a BabyAI instruction: both names are written into hashes and exports"
}
SAME_FILE = {  # a name that several packages share, for the same role in each
    "columns": "the columns of a kind's tables",
    "events": "the events of a kind, and those of every session",
    "page_values": "a kind's screens as values for the page",
    "plan": "the plan of a kind of activity",
    "report": "a kind's section of the report",
    "requests": "what a kind asks of the session host, and the inputs that answer",
    "rows": "a kind's rows in logs and tables, and tables' rows",
    "screens": "the screens of a kind, and those that every kind may show",
    "simulation": "how a simulated person does the parts of a kind",
    "tables": "a kind's tables, and the exporters of tables",
    "widget": "what a question of a kind shows",
    "activity": "the activity of a kind, and what every activity is",
    "batch": "many worlds of a kind in one call",
    "belief_state": "what an agent has seen of a kind of world",
    "draft": "the answer in progress to a question of a kind",
    "drawing": "the pictures of a kind of world",
    "design": "the design of a block, and the study designs",
    "early_plans": "a kind's parts in plans that were recorded before plans had parts",
    "server_needs": "what in a kind's part a page cannot run alone",
    "env": "the Gymnasium environment of a kind of world",
    "machine": "commands about this machine, and what a log says of it",
    "go_to_obj": "GoToObj: its grid world, its 3D world, and what the two share",
    "imitation": "a library of that name, and learning of that name",
    "messages": "what a team's people write to each other, and what the page and the server do",
    "options": "options of commands, and of worlds",
    "make": "where older data sets look for a kind of world",
    "paths": "where logs lie, and paths over a floor plan",
    "planner": "the shortest path in a kind of world",
    "preferences": "the activity, and the learner from what it logs",
    "rooms": "rooms of a kind of world",
    "rules": "what an action does in a kind of world",
    "search": "best-first search in a kind of world",
    "state": "the state of a kind of world, and its hash",
    "world": "a world as a session needs it, and the class to write one with",
}

FROM_LIBRARIES = {"freetype.Face", "harfbuzz.Face", "traitlets.Bytes"}  # what a library calls a thing, where we use it


def _modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if not path.stem.endswith("_pb2")]


def _trees() -> dict[Path, ast.Module]:
    return {path: parse_source(path) for path in _modules()}


def test_no_public_class_name_stands_twice():
    places = defaultdict(list)
    for path, tree in _trees().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(PACKAGE)))
    assert {name: where for name, where in places.items() if len(where) > 1 and name not in SAME_CLASS} == {}


def test_a_module_is_a_noun():
    assert [str(path.relative_to(PACKAGE)) for path in _modules() if path.stem in NOT_NOUNS] == []


def test_two_modules_share_a_file_name_only_for_the_same_role():
    places = defaultdict(list)
    for path in _modules():
        if not path.stem.startswith("__"):
            places[path.stem].append(str(path.relative_to(PACKAGE)))
    assert {name: where for name, where in places.items() if len(where) > 1 and name not in SAME_FILE} == {}


def test_no_replaced_name_comes_back():
    with TABLE.open(encoding="utf-8", newline="") as file:
        replaced = {row["old"]: row["new"] for row in csv.DictReader(file, delimiter="\t")}
    hits = defaultdict(set)
    for path, tree in _trees().items():
        for node in ast.walk(tree):
            for name in _identifiers(node):
                if name in replaced:
                    hits[f"{name} (now {replaced[name]})"].add(str(path.relative_to(PACKAGE)))
    assert dict(hits) == {}


def _identifiers(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Attribute) and ast.unparse(node) in FROM_LIBRARIES:
        return []
    found = [getattr(node, field, None) for field in ("id", "attr", "name", "arg", "asname")]
    return [one.rpartition(".")[2] for one in found if isinstance(one, str)]
