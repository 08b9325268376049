"""A mutant: one change of the text of one module of the package, and the lines that are executed where it acts."""

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import minihuman

PACKAGE = "minihuman"
ROOT = Path(__file__).parents[2]
SOURCES = Path(minihuman.__file__).parent  # in the checkout, or in an installed wheel


class MutationError(RuntimeError):
    """A mutant, a record or a run of tests that cannot be used as it is."""


@dataclass(frozen=True)
class Mutant:
    """A change of one place.

    Args:
        meaning: what the package does wrongly, or the operator that changed it.
        file: the module, by its path in the package.
        old: text that the module holds exactly once.
        new: what stands there instead.
        tests: the tests that should notice it; empty where the record of executed lines names them.
    """

    meaning: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...] = ()

    def fits(self, source: str) -> bool:
        """Whether the place is in the source exactly once."""
        return source.count(self.old) == 1

    def mutate(self, source: str) -> str:
        """Return the source with the change.

        Raises:
            MutationError: if the place is not there exactly once.
        """
        if not self.fits(source):
            raise MutationError(
                f"{self.file} holds {source.count(self.old)} times what is to be changed: {self.old!r}; "
                "run `python -m tests.mutations draw`, or correct the planted mutant"
            )
        return source.replace(self.old, self.new)

    def line(self, source: str) -> int:
        """Return the number of the first line that changes."""
        return source.count("\n", 0, self._offset(source)) + 1

    def executed_lines(self, source: str) -> range:
        """Return the lines of the statement that changes; of a function's header, those of its first statement.

        Empty outside functions, where each process executes the line as it imports the module.
        """
        return executed_lines(ast.parse(source), self.line(source))

    def change(self, source: str) -> tuple[str, str]:
        """Return the lines that differ, without their indentation, before and after."""
        before = source.split("\n")
        after = self.mutate(source).split("\n")
        start = _count_common(before, after)
        end = _count_common(before[start:][::-1], after[start:][::-1])
        return _joined(before[start : len(before) - end]), _joined(after[start : len(after) - end])

    def _offset(self, source: str) -> int:
        return source.index(self.old) + _count_common(self.old, self.new)


def executed_lines(tree: ast.Module, line: int) -> range:
    """Return the lines of the innermost statement around a line, if it is in a function."""
    function, statement = _innermost(tree, line)
    if function is None or statement is None:
        return range(0)
    if statement is function:
        statement = _first_statement(function)
    body = getattr(statement, "body", None)  # of a compound statement only the header
    end = body[0].lineno - 1 if isinstance(body, list) else statement.end_lineno or statement.lineno
    return range(statement.lineno, max(end, statement.lineno) + 1)


Function = ast.FunctionDef | ast.AsyncFunctionDef


def _innermost(tree: ast.Module, line: int) -> tuple[Function | None, ast.stmt | None]:
    function: Function | None = None
    statement: ast.stmt | None = None
    for node in ast.walk(tree):  # breadth first: what lies deeper comes later
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or node.lineno):
            statement = node
            function = node if isinstance(node, Function) else function
    return function, statement


def _first_statement(function: Function) -> ast.stmt:
    return function.body[1] if ast.get_docstring(function) is not None and len(function.body) > 1 else function.body[0]


def _joined(lines: list[str]) -> str:
    return " ".join(line.strip() for line in lines)


def _count_common(first: Sequence[str], second: Sequence[str]) -> int:
    """Return with how many equal lines, or characters of a text, both begin."""
    pairs = enumerate(zip(first, second, strict=False))
    return next((count for count, (left, right) in pairs if left != right), min(len(first), len(second)))
