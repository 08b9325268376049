"""Mutation operators: the standard small changes of a function's code, as edits of its text.

They are those of mutmut and Cosmic Ray. Texts stay: a changed message is the business of the tests of words. Code
within f-strings stays, too, as Python 3.11 does not say where it stands.
"""

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tests.mutations.mutant import Function

NEGATED: dict[type[ast.cmpop], str] = {
    ast.Lt: ">=",
    ast.LtE: ">",
    ast.Gt: "<=",
    ast.GtE: "<",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.Is: "is not",
    ast.IsNot: "is",
    ast.In: "not in",
    ast.NotIn: "in",
}
SHIFTED: dict[type[ast.cmpop], str] = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
COMPARISON = re.compile(r"<=|>=|==|!=|<|>|\bis\s+not\b|\bis\b|\bnot\s+in\b|\bin\b")
SIMPLE = (ast.Name, ast.Constant, ast.Attribute, ast.Call, ast.Subscript)  # `x + 1` needs no brackets around these


@dataclass(frozen=True)
class Edit:
    """Text that replaces the characters of a source from `start` to `end`."""

    operator: str
    start: int
    end: int
    text: str


class Source:
    """A module's text, and where the nodes of its syntax tree stand in it."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tree = ast.parse(text)
        self._lines = text.split("\n")
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line) + 1)

    def start(self, node: ast.expr | ast.stmt | ast.arg) -> int:
        """Return the offset of a node's first character."""
        return self._offset(node.lineno, node.col_offset)

    def end(self, node: ast.expr | ast.stmt | ast.arg) -> int:
        """Return the offset behind a node's last character."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._offset(node.end_lineno, node.end_col_offset)

    def _offset(self, line: int, column: int) -> int:
        """Return the offset of a place that the tree gives by line, from one, and bytes of UTF-8."""
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())


def negate_comparison(source: Source, node: ast.AST) -> Iterator[Edit]:
    yield from _compare(source, node, "negate_comparison", NEGATED)


def shift_boundary(source: Source, node: ast.AST) -> Iterator[Edit]:
    yield from _compare(source, node, "shift_boundary", SHIFTED)


def swap_and_or(source: Source, node: ast.AST) -> Iterator[Edit]:
    if not isinstance(node, ast.BoolOp) or len(node.values) != 2:  # the second edit of three would change another
        return
    old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
    yield from _between(source, node.values[0], node.values[1], rf"\b{old}\b", "swap_and_or", new)


def drop_not(source: Source, node: ast.AST) -> Iterator[Edit]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        start = source.start(node)
        yield Edit("drop_not", start, start + len("not "), "")


def replace_constant(source: Source, node: ast.AST) -> Iterator[Edit]:
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        yield Edit("replace_constant", source.start(node), source.end(node), repr(_other(node.value)))


def return_none(source: Source, node: ast.AST) -> Iterator[Edit]:
    if isinstance(node, ast.Return) and node.value is not None:
        yield Edit("return_none", source.start(node.value), source.end(node.value), "None")


def return_early(source: Source, node: ast.AST) -> Iterator[Edit]:
    if not isinstance(node, Function) or _gives_values(node):
        return
    documented = ast.get_docstring(node) is not None
    body = node.body[1:] if documented else node.body
    if body and body[0].lineno > node.lineno and not isinstance(body[0], ast.Raise | ast.Pass | ast.Return):
        start = source.start(body[0])
        yield Edit("return_early", start, start, "return\n" + " " * body[0].col_offset)


def delete_call(source: Source, node: ast.AST) -> Iterator[Edit]:
    called = node.value if isinstance(node, ast.Expr) else None
    called = called.value if isinstance(called, ast.Await) else called
    if isinstance(node, ast.Expr) and isinstance(called, ast.Call):
        yield Edit("delete_call", source.start(node), source.end(node), "pass")


def swap_plus_minus(source: Source, node: ast.AST) -> Iterator[Edit]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        left, right, sign = node.left, node.right, ""
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub):
        left, right, sign = node.target, node.value, "="
    else:
        return
    old, new = ("+", "-") if isinstance(node.op, ast.Add) else ("-", "+")
    yield from _between(source, left, right, re.escape(old + sign), "swap_plus_minus", new + sign)


def remove_default(source: Source, node: ast.AST) -> Iterator[Edit]:
    if not isinstance(node, ast.arguments):
        return
    positional = [*node.posonlyargs, *node.args]
    pairs = [(positional[-len(node.defaults)], node.defaults[0])] if node.defaults else []
    pairs += [pair for pair in zip(node.kwonlyargs, node.kw_defaults, strict=True) if pair[1] is not None]
    for argument, default in pairs:
        yield Edit("remove_default", source.end(argument), source.end(default), "")


def shift_slice(source: Source, node: ast.AST) -> Iterator[Edit]:
    if isinstance(node, ast.Slice):
        for bound in filter(None, (node.lower, node.upper)):
            start, end = source.start(bound), source.end(bound)
            text = source.text[start:end]
            yield Edit("shift_slice", start, end, f"{text} + 1" if isinstance(bound, SIMPLE) else f"({text}) + 1")


OPERATORS: tuple[Callable[[Source, ast.AST], Iterator[Edit]], ...] = (
    negate_comparison,
    shift_boundary,
    swap_and_or,
    drop_not,
    replace_constant,
    return_none,
    return_early,
    delete_call,
    swap_plus_minus,
    remove_default,
    shift_slice,
)


def find_edits(text: str) -> list[Edit]:
    """Return the edits of a module's functions in the order of their places; a few are no mutants."""
    source = Source(text)
    edits = {edit for function in _functions(source.tree) for node in _code(function) for edit in _apply(source, node)}
    return sorted(edits, key=lambda edit: (edit.start, edit.operator, edit.text))


def is_mutant(text: str, edit: Edit) -> bool:
    """Return whether the edited text is a program, and another one."""
    try:
        changed = ast.parse(apply_edit(text, edit))
        compile(changed, "mutant", "exec", dont_inherit=True)
    except SyntaxError:
        return False
    return ast.dump(changed) != ast.dump(ast.parse(text))


def apply_edit(text: str, edit: Edit) -> str:
    """Return the text with an edit."""
    return text[: edit.start] + edit.text + text[edit.end :]


def _apply(source: Source, node: ast.AST) -> Iterator[Edit]:
    for operator in OPERATORS:
        yield from operator(source, node)


def _functions(tree: ast.Module) -> Iterator[Function]:
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def _code(function: Function) -> Iterator[ast.AST]:
    """Yield the nodes of a function that it executes: no annotations, decorators, f-strings."""
    yield function
    yield function.args
    pending: list[ast.AST] = list(function.body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.JoinedStr | Function | ast.ClassDef):
            continue  # functions come by themselves
        yield node
        annotation = node.annotation if isinstance(node, ast.AnnAssign) else None
        pending += (child for child in ast.iter_child_nodes(node) if child is not annotation)


def _other(constant: bool | float) -> bool | float:
    match constant:
        case bool():
            return not constant
        case int():
            return constant + 1
        case _:
            return 2 * constant or 1.0


def _compare(source: Source, node: ast.AST, operator: str, replacements: dict[type[ast.cmpop], str]) -> Iterator[Edit]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in replacements:
        new = replacements[type(node.ops[0])]
        yield from _between(source, node.left, node.comparators[0], COMPARISON.pattern, operator, new)


def _between(source: Source, left: ast.expr, right: ast.expr, sign: str, operator: str, new: str) -> Iterator[Edit]:
    """Replace the sign between two operands, around which brackets may stand."""
    match = re.compile(sign).search(source.text, source.end(left), source.start(right))
    if match:
        yield Edit(operator, match.start(), match.end(), new)


def _gives_values(function: Function) -> bool:
    """Return whether a function returns or yields values."""
    returned = [node.value for node in _code(function) if isinstance(node, ast.Return)]
    yields = any(isinstance(node, ast.Yield | ast.YieldFrom) for node in _code(function))
    return yields or any(returned)
