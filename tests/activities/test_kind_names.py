"""No module outside a kind's folder knows the kind by its name or its folder, but for lists that may only shrink."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import minihuman
from minihuman.experiment.machine.activity import list_built_in_kinds

PACKAGE = Path(minihuman.__file__).parent
EXCEPTIONS = Path(__file__).with_name("known_kinds.tsv")  # which module imports which kind's folder: only ever shorter
NAME_EXCEPTIONS = {  # modules that name a kind, with why; no module may join them
    "experiment/machine/events.py": "the kind of a note, which is no kind of activity, can be 'page'",
    "experiment/replay.py": "the kind of a note, which is no kind of activity, can be 'page'",
    "experiment/plan/part_plans.py": "the protocol's own tables, [[pages]] and [[questions]], are parts of these kinds",
}
SHARED_FOLDERS = {"play"}  # a block is a PlayPlan: the contract of kinds of blocks, and its base class
TAKERS_OF_KINDS = ("find_kind", "find_installed_kind", "PlannedPart")


@cache
def _modules() -> dict[str, ast.Module]:
    """The modules outside the kinds' folders that have a kind's name in quotes, or name a folder."""
    marks = ("minihuman.activities", *(f'"{kind}"' for kind in list_built_in_kinds()))
    trees = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        text = path.read_text(encoding="utf-8")
        if not name.startswith("activities/") and any(mark in text for mark in marks):
            trees[name] = ast.parse(text)
    return trees


def _find_literals(tree: ast.Module) -> dict[str, set[str]]:
    """The strings in each constant of a module."""
    return {
        target.id: _list_strings(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def _list_strings(node: ast.AST) -> set[str]:
    return {part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and isinstance(part.value, str)}


def _is_kind(node: ast.AST) -> bool:
    """Whether an expression is a kind of activity, by what it is called."""
    match node:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name in ("kind", "kinds") or name.endswith(("_kind", "_kinds"))
        case ast.Subscript(slice=ast.Constant(value="kind")):
            return True
        case ast.Call(func=ast.Attribute(attr="get"), args=[ast.Constant(value="kind"), *_]):
            return True
    return False


def _list_compared(tree: ast.Module) -> Iterator[tuple[int, set[str]]]:
    """Each place where something called a kind meets strings, with the strings."""
    literals = _find_literals(tree)
    for node in ast.walk(tree):
        match node:
            case ast.Compare():
                operands = [node.left, *node.comparators]
            case ast.BinOp(op=ast.Sub() | ast.BitAnd()):
                operands = [node.left, node.right]
            case ast.Match():
                operands = [node.subject, *(case.pattern for case in node.cases)]
            case ast.Call(func=ast.Name(id=name)) if name in TAKERS_OF_KINDS:
                yield node.lineno, {first.value for first in node.args[:1] if isinstance(first, ast.Constant)}
                continue
            case _:
                continue
        if any(_is_kind(operand) for operand in operands):
            strings = set().union(*(_list_strings(operand) for operand in operands))
            names = {part.id for operand in operands for part in ast.walk(operand) if isinstance(part, ast.Name)}
            yield node.lineno, strings.union(*(literals.get(name, set()) for name in names))


def test_no_module_outside_a_kinds_folder_asks_for_the_kind_by_its_name():
    kinds = {*list_built_in_kinds()}
    places = {
        f"{module}:{line}"
        for module, tree in _modules().items()
        if module not in NAME_EXCEPTIONS
        for line, strings in _list_compared(tree)
        if strings & kinds
    }
    assert places == set(), "ask the registry: give ActivityKind a field that says what the kind has to say"


def test_every_module_that_may_name_a_kind_does():
    kinds = {*list_built_in_kinds()}
    for module in NAME_EXCEPTIONS:
        assert any(strings & kinds for _, strings in _list_compared(_modules()[module])), f"{module} needs no exception"


def test_a_comparison_with_a_kinds_name_is_seen_in_each_form():
    program = """
NAMES = ("play", "trials")
if block.kind == "team": pass
if part_kind in NAMES: pass
left = kinds - {*NAMES}
match part.kind:
    case "rating": pass
find_kind("pages")
if spec["kind"] != "team" or settings.get("kind", "play") == "team": pass
if question == "team": pass
"""
    lines = {line for line, strings in _list_compared(ast.parse(program)) if strings}
    assert lines == {3, 4, 5, 6, 8, 9}


def _list_imported_kinds(module: str, tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            parts = name.split(".")
            is_folder = parts[:2] == ["minihuman", "activities"] and len(parts) > 2
            if is_folder and (PACKAGE / "activities" / parts[2]).is_dir() and parts[2] not in SHARED_FOLDERS:
                yield module, parts[2]


def test_the_modules_that_import_a_kinds_folder_only_become_fewer():
    known = {tuple(line.split("\t")) for line in EXCEPTIONS.read_text(encoding="utf-8").splitlines()[1:]}
    imported = {pair for module, tree in _modules().items() for pair in _list_imported_kinds(module, tree)}
    assert imported - known == set(), "ask the registry, or the kind's own folder, instead"
    assert known - imported == set(), f"take these lines out of {EXCEPTIONS.name}: they are needed no longer"
