"""No module imports, by whatever way, a module that imports it: lazy imports and those for typing count.

The linter's contracts compare packages; this compares modules. `import minihuman` alone does not count: it is there
for the version and the package's folder.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import minihuman
from tests.sources import parse_source

PACKAGE = Path(minihuman.__file__).parent  # of the checkout, or of an installed wheel
Imports = dict[str, set[str]]  # a module -> the modules that it imports


def read_imports(package: Path) -> Imports:
    """The imports among a package's modules, each named without the package."""
    paths = {_name_module(path, package): path for path in sorted(package.rglob("*.py"))}
    paths.pop("")  # the package itself
    imports: Imports = {}
    for module, path in paths.items():
        inside = module if path.name == "__init__.py" else module.rpartition(".")[0]
        targets = _find_imports(parse_source(path), package.name, inside)
        named = {target if target in paths else target.rpartition(".")[0] for target in targets}
        imports[module] = (named & paths.keys()) - {module}
    return imports


def _name_module(path: Path, package: Path) -> str:
    parts = path.relative_to(package).with_suffix("").parts
    return ".".join(parts).removesuffix("__init__").rstrip(".")


def _find_imports(tree: ast.Module, package: str, inside: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name.removeprefix(f"{package}.")
        elif isinstance(node, ast.ImportFrom):
            above = inside.split(".")[: inside.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, node.module or ""]).strip(".")
            if node.level or base.startswith(f"{package}."):
                for alias in node.names:
                    yield f"{base.removeprefix(f'{package}.')}.{alias.name}".strip(".")


def find_circles(imports: Imports) -> set[frozenset[str]]:
    """The groups of two modules or more that reach each other, by Tarjan's algorithm."""
    circles: set[frozenset[str]] = set()
    numbers: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []

    def visit(module: str) -> None:
        numbers[module] = lowest[module] = len(numbers)
        stack.append(module)
        for target in imports[module]:
            if target not in numbers:
                visit(target)
                lowest[module] = min(lowest[module], lowest[target])
            elif target in stack:
                lowest[module] = min(lowest[module], numbers[target])
        if lowest[module] == numbers[module]:
            at = stack.index(module)
            if len(stack) - at > 1:
                circles.add(frozenset(stack[at:]))
            del stack[at:]

    for module in imports:
        if module not in numbers:
            visit(module)
    return circles


def test_no_modules_import_each_other() -> None:
    circles = [sorted(circle) for circle in find_circles(read_imports(PACKAGE))]
    assert circles == [], "these import each other; have what both need in a third module"


@pytest.mark.parametrize(
    "text",
    [
        "from thing.first import FIRST",
        "def use():\n    from thing.first import FIRST",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from thing.first import FIRST",
        "import thing.first",
        "from . import first",
        "from .first import FIRST",
    ],
    ids=["at load", "lazy", "typing", "by its full name", "beside", "from beside"],
)
def test_a_circle_is_found_however_its_modules_are_imported(text: str, tmp_path: Path) -> None:
    package = tmp_path / "thing"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "first.py").write_text("from thing.second import SECOND\n", encoding="utf-8", newline="\n")
    (package / "second.py").write_text(text, encoding="utf-8", newline="\n")
    (package / "third.py").write_text("import thing.first\n", encoding="utf-8", newline="\n")
    assert find_circles(read_imports(package)) == {frozenset({"first", "second"})}
