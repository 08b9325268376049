"""Expressions of an author's rules, as expressions of the translated source that Numba compiles.

A refusal names the line and what to write instead.
"""

import ast
import math
from collections.abc import Mapping
from types import FunctionType
from typing import Any, NoReturn

import numpy as np

from minihuman.worlds.grid.object_kinds import ObjectKind
from minihuman.worlds.grid.own.fields import Bool, Float, Int, IntTuple, OwnField
from minihuman.worlds.grid.own.source_names import (
    CELL_PARTS,
    CODE_FUNCTIONS,
    ITEM_FUNCTIONS,
    SELF,
    FunctionSource,
    Symbol,
    TranslationError,
    find_global,
)

_OPERATORS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "truediv", ast.FloorDiv: "floordiv"}
_OPERATORS |= {ast.Mod: "mod", ast.Pow: "power", ast.LShift: "lshift", ast.RShift: "rshift"}
_BIT_OPERATORS = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
_COMPARISONS = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_COMPARISONS |= {ast.Is: "is", ast.IsNot: "is not"}
# by attribute, the index in the row of state
_STATE_NUMBERS = {"direction": 4, "carrying": 5, "step": 6, "max_steps": 7, "width": 0, "height": 1}
_SELF_NUMBERS = {"width": 0, "height": 1, "agent_dir": 4, "step_count": 6, "max_steps": 7}
CELLS = "rt.view_2(rt.row(c), 24, rt.row(c)[0], rt.row(c)[1])"
_MATH = {math.sqrt: "math.sqrt", math.floor: "math.floor", math.ceil: "math.ceil", math.fabs: "abs"}


class Expressions:
    """The translation of one function's expressions. `rule_statements.Statements` adds its statements."""

    program: Any  # the `translation.Translation` of which this is a function
    function: Any  # the author's function, a FunctionType
    owner: type | None
    source: FunctionSource
    symbols: dict[str, Symbol]  # parameters and local names that stand for `self`, `grid` and such
    variables: set[str]  # names that the function binds
    lengths: dict[str, int]  # the lengths of local lists, by name

    def place(self, node: ast.AST) -> int:
        """Return the number of a node's place, its file and line, in the program's table of places."""
        number: int = self.program.number_place(self.source.path, getattr(node, "lineno", 1) + self.source.offset)
        return number

    def refuse(self, node: ast.AST, what: str, instead: str) -> NoReturn:
        """Raise a TranslationError for a node of the author's source.

        Args:
            node: the node.
            what: what cannot be translated.
            instead: what to write instead.

        Raises:
            TranslationError: always; the message names the line.
        """
        line = getattr(node, "lineno", 1) + self.source.offset
        raise TranslationError(f"{self.source.path}:{line}: {what} cannot be translated; {instead}")

    def _item(self, node: ast.Call, callee: Any) -> str:
        """Return the translation of a call of ``callee`` that makes an item; `LayoutCalls` defines it."""
        raise NotImplementedError

    def _layout_call(self, node: ast.Call, name: str) -> str:
        """Return the translation of a call of the layout's method ``name``; `LayoutCalls` defines it."""
        raise NotImplementedError

    # --- what names stand for ---

    def symbol(self, node: ast.AST) -> Symbol | None:
        """Return the meaning of a name, attribute or constant; None if its value is computed when the rules run."""
        if isinstance(node, ast.Constant):
            return Symbol("constant", node.value)
        if isinstance(node, ast.Name):
            return self._name_symbol(node)
        if isinstance(node, ast.Attribute):
            return self._attribute_symbol(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            operand = self.symbol(node.operand)
            if operand is not None and type(operand.value) in (int, float):
                return Symbol("constant", -operand.value)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super" and not node.args:
            return Symbol("super", self.owner)
        if isinstance(node, ast.Tuple):
            elements = [self.symbol(element) for element in node.elts]
            if all(element is not None and element.kind == "constant" for element in elements):
                return Symbol("constant", tuple(element.value for element in elements if element is not None))
        return None

    def _name_symbol(self, node: ast.Name) -> Symbol | None:
        """Return the meaning of a name; None for a variable. A name that nothing defines is refused."""
        if node.id in self.symbols:
            return self.symbols[node.id]
        if node.id in self.variables:
            return None
        try:
            return Symbol("constant", find_global(self.function, node.id))
        except KeyError:
            self.refuse(node, f"the name {node.id}", "define it in the module")

    def _attribute_symbol(self, node: ast.Attribute) -> Symbol | None:
        """Return the meaning of an attribute; None if it is computed when the rules run. An unknown one is refused."""
        base = self.symbol(node.value)
        if base is None:
            return None
        if base.kind == "self":
            return self._self_attribute(node)
        if base.kind == "state" and node.attr in ("row", *CELL_PARTS):
            return Symbol(node.attr)
        if base.kind == "constant":
            if not hasattr(base.value, node.attr):
                self.refuse(node, f"the attribute {node.attr}", "name one that exists")
            return Symbol("constant", getattr(base.value, node.attr))
        return None

    def _self_attribute(self, node: ast.Attribute) -> Symbol | None:
        """Return the meaning of an attribute of ``self``; None for one that is read when the rules run."""
        if node.attr == "state":
            return Symbol("state")
        if node.attr == "np_random":
            return Symbol("rng")
        if node.attr == "_row":
            return Symbol("row")
        if node.attr in _SELF_NUMBERS or node.attr in ("agent_pos", "mission"):
            return None
        is_constant, constant = self.program.fixed_attribute(node.attr)
        return Symbol("constant", constant) if is_constant else None

    # --- expressions ---

    def expression(self, node: ast.AST) -> str:
        """Return an expression's translation; refuse an expression of a kind that cannot be translated."""
        symbol = self.symbol(node)
        if symbol is not None:
            return self._symbol_text(node, symbol)
        method = getattr(self, f"_translate_{type(node).__name__.lower()}", None)
        if method is None:
            name = type(node).__name__
            self.refuse(node, f"an expression of the kind {name}", "use numbers, tuples, declared fields and loops")
        text: str = method(node)
        return text

    def _symbol_text(self, node: ast.AST, symbol: Symbol) -> str:
        """Return the translation of a name that stands for a constant or for the row; refuse any other."""
        if symbol.kind == "row":
            return "rt.row(c)"
        if symbol.kind != "constant":
            self.refuse(node, f"{ast.unparse(node)} as an operand", "read one of its attributes or elements")
        text = self.program.constant(symbol.value)
        if text is None:
            what = f"{ast.unparse(node)}, a {type(symbol.value).__name__},"
            self.refuse(node, what, "use numbers, texts, items and tuples of them")
        return str(text)

    def _translate_name(self, node: ast.Name) -> str:
        return f"v_{node.id}"

    def _translate_tuple(self, node: ast.Tuple) -> str:
        if any(isinstance(element, ast.Starred) for element in node.elts):
            self.refuse(node, "a starred element", "write the elements one by one")
        return "(" + "".join(f"{self.expression(element)}, " for element in node.elts) + ")"

    def _translate_attribute(self, node: ast.Attribute) -> str:
        base = self.symbol(node.value)
        if base is None:
            if node.attr in ("identity", "x", "y"):
                return f"({self.expression(node.value)})[{('identity', 'x', 'y').index(node.attr)}]"
            self.refuse(node, f"the attribute {node.attr}", "only what `place` and `put` return has attributes")
        if base.kind == "self":
            return self._own_attribute(node)
        if base.kind == "state":
            if node.attr == "position":
                return "(np.int64(rt.row(c)[2]), np.int64(rt.row(c)[3]))"
            if node.attr == "cells":
                return CELLS
            if node.attr in _STATE_NUMBERS:
                return f"np.int64(rt.row(c)[{_STATE_NUMBERS[node.attr]}])"
        if base.kind == "grid" and node.attr in ("width", "height"):
            return f"rt.{node.attr}(c)"
        self.refuse(node, f"{ast.unparse(node)}", "docs/grid-worlds.md lists what can be read")

    def _own_attribute(self, node: ast.Attribute) -> str:
        """Return the translation of an attribute of ``self``: a field, a property or a setting."""
        name = node.attr
        if name in _SELF_NUMBERS and not self.program.is_team:
            return f"np.int64(rt.row(c)[{_SELF_NUMBERS[name]}])"
        if name == "agent_pos":
            return "(np.int64(rt.row(c)[2]), np.int64(rt.row(c)[3]))"
        field = self.program.fields.get(name)
        if field is not None:
            return self._field(field)
        read = self.program.property_of(name)
        if read is not None:
            call = ast.copy_location(ast.Call(node, [], []), node)
            return self._author_call(call, *read)
        setting = self.program.setting(name)
        if setting is None:
            self.refuse(
                node,
                f"self.{name}",
                f"declare it in the class, such as {name} = Int(), or set it in __init__ and leave it",
            )
        return str(setting)

    def _field(self, field: OwnField) -> str:
        """Return the translation of reading a declared field."""
        offset = field.offset
        if isinstance(field, Bool):
            return f"(rt.own(c)[{offset}] != 0)"
        if isinstance(field, Int):
            return f"rt.own(c)[{offset}]"
        if isinstance(field, Float):
            return f"rt.own_floats(c)[{offset}]"
        if isinstance(field, IntTuple):
            return "(" + "".join(f"rt.own(c)[{offset + k}], " for k in range(field.size)) + ")"
        memory = "rt.own_floats(c)" if field.dtype is np.float64 else "rt.own(c)"
        shape = field.shape
        return f"rt.view_{len(shape)}({memory}, {offset}, {', '.join(map(str, shape))})"

    def _translate_unaryop(self, node: ast.UnaryOp) -> str:
        operand = self.expression(node.operand)
        if isinstance(node.op, ast.Not):
            return f"(not {operand})"
        if isinstance(node.op, ast.USub):
            return f"rt.neg(c, {self.place(node)}, {operand})"
        return f"({'~' if isinstance(node.op, ast.Invert) else '+'}{operand})"

    def _translate_binop(self, node: ast.BinOp) -> str:
        left = self.expression(node.left)
        right = self.expression(node.right)
        return self.operation(node, node.op, left, right)

    def operation(self, node: ast.AST, operator: ast.operator, left: str, right: str) -> str:
        """Return the translation of an operation on two translated operands; refuse an operator without translation."""
        if type(operator) in _BIT_OPERATORS:
            return f"({left} {_BIT_OPERATORS[type(operator)]} {right})"
        if type(operator) not in _OPERATORS:
            self.refuse(node, "this operator", "use + - * / // % ** << >> & | ^")
        return f"rt.{_OPERATORS[type(operator)]}(c, {self.place(node)}, {left}, {right})"

    def _translate_boolop(self, node: ast.BoolOp) -> str:
        word = " and " if isinstance(node.op, ast.And) else " or "
        return "(" + word.join(self.expression(operand) for operand in node.values) + ")"

    def _translate_ifexp(self, node: ast.IfExp) -> str:
        parts = (self.expression(part) for part in (node.body, node.test, node.orelse))
        return "({} if {} else {})".format(*parts)

    def _translate_compare(self, node: ast.Compare) -> str:
        clauses = []
        left = node.left
        if len(node.ops) > 1 and not all(self._is_simple(part) for part in node.comparators[:-1]):
            self.refuse(node, "a chain of comparisons with a call in the middle", "compare twice, with `and`")
        for operator, right in zip(node.ops, node.comparators, strict=True):
            clauses.append(self._comparison(node, operator, left, right))
            left = right
        return "(" + " and ".join(clauses) + ")"

    @staticmethod
    def _is_simple(node: ast.AST) -> bool:
        """Return whether an expression calls nothing, so that evaluating it twice changes nothing."""
        return not any(isinstance(part, ast.Call) for part in ast.walk(node))

    def _comparison(self, node: ast.AST, operator: ast.cmpop, left: ast.AST, right: ast.AST) -> str:
        """Return the translation of one comparison of two expressions."""
        if not isinstance(operator, ast.In | ast.NotIn):
            return f"{self.expression(left)} {_COMPARISONS[type(operator)]} {self.expression(right)}"
        negation = "not " if isinstance(operator, ast.NotIn) else ""
        if isinstance(right, ast.Call) and isinstance(right.func, ast.Name) and right.func.id == "range":
            self.refuse(node, "`in range(...)`", "write low <= x < high")
        if isinstance(right, ast.Set | ast.List):
            right = ast.copy_location(ast.Tuple(right.elts, ast.Load()), right)
        return f"({negation}rt.is_in(c, {self.place(node)}, {self.expression(left)}, {self.expression(right)}))"

    def _translate_subscript(self, node: ast.Subscript) -> str:
        base = self.symbol(node.value)
        place = self.place(node)
        if base is not None and base.kind in CELL_PARTS:
            i, j = self._pair(node)
            return CELL_PARTS[base.kind].format(f"rt.at_2(c, {place}, {CELLS}, {i}, {j})")
        values = self.expression(node.value)
        if isinstance(node.slice, ast.Slice):
            return f"{values}[{self._slice(node.slice)}]"
        if isinstance(node.slice, ast.Tuple):
            i, j = self._pair(node)
            return f"rt.at_2(c, {place}, {values}, {i}, {j})"
        function = "row_of" if self.matrix_field(node.value) is not None else "at"
        return f"rt.{function}(c, {place}, {values}, {self.expression(node.slice)})"

    def matrix_field(self, node: ast.AST) -> Any:
        """Return the declared field of two dimensions that an expression names; None if it names none."""
        if isinstance(node, ast.Attribute):
            base = self.symbol(node.value)
            field = self.program.fields.get(node.attr) if base is not None and base.kind == "self" else None
            if field is not None and len(getattr(field, "shape", ())) == 2:
                return field
        return None

    def _slice(self, node: ast.Slice) -> str:
        """Return the translation of a slice, whose ends must be constants."""
        parts = []
        for part in (node.lower, node.upper):
            symbol = None if part is None else self.symbol(part)
            if part is not None and (symbol is None or not isinstance(symbol.value, int)):
                self.refuse(node, "a slice with computed ends", "use whole numbers as ends")
            parts.append("" if symbol is None else str(symbol.value))
        if node.step is not None:
            self.refuse(node, "a slice with a step", "use a loop")
        return ":".join(parts)

    def _pair(self, node: ast.Subscript) -> tuple[str, str]:
        """Return the translations of both indices of an array of two dimensions."""
        if isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2:
            first, second = (self.expression(element) for element in node.slice.elts)
            return first, second
        pair = f"rt.unpack_2(c, {self.place(node)}, {self.expression(node.slice)})"
        return f"{pair}[0]", f"{pair}[1]"

    # --- calls ---

    def _translate_call(self, node: ast.Call) -> str:
        has_star = any(isinstance(argument, ast.Starred) for argument in node.args)
        has_double_star = any(keyword.arg is None for keyword in node.keywords)
        if has_star or has_double_star:
            self.refuse(node, "a call with * or **", "write the arguments one by one")
        if isinstance(node.func, ast.Attribute):
            base = self.symbol(node.func.value)
            if base is not None and base.kind != "constant":
                return self._method(node, base, node.func.attr)
        callee = self.symbol(node.func)
        if callee is None:
            self.refuse(node, f"a call of {ast.unparse(node.func)}", "call functions of the module and methods of self")
        return self._constant_call(node, callee.value)

    def _method(self, node: ast.Call, base: Symbol, name: str) -> str:
        """Return the translation of a method call on `self`, `super()`, the grid, the state or the random generator."""
        if base.kind == "self":
            return self._self_call(node, name)
        if base.kind == "super":
            return self._super_call(node, name, base.value)
        if base.kind == "grid":
            return self._layout_call(node, name)
        arguments = [self.expression(argument) for argument in node.args]
        place = self.place(node)
        if base.kind == "state" and name == "find":
            return f"rt.find(c, {place}, {arguments[0]})"
        if base.kind == "rng" and not node.keywords:
            if name == "integers" and len(arguments) in (1, 2):  # one argument is the upper end, and the lower is 0
                return self.mark_draw(f"rt.draw(c, {place}, {', '.join(['0', *arguments][-2:])})")
            if name == "random" and not arguments:
                return self.mark_draw(f"rt.draw_random(c, {place})")
        self.refuse(node, f"{ast.unparse(node.func)}(...)", "of the generator, integers(low, high) and random() are")

    def mark_draw(self, text: str) -> str:
        """Record that the rules draw random numbers, and return ``text``, the translation that draws one."""
        self.program.draws = True
        return text

    def _self_call(self, node: ast.Call, name: str) -> str:
        """Return the translation of a call of one of the author's methods, or of one that the base classes have."""
        if name == "is_kind" and len(node.args) == 2:
            kind = self.symbol(node.args[1])
            if kind is None or not isinstance(kind.value, ObjectKind):
                self.refuse(node, "is_kind with a computed kind", "name the kind")
            return f"({self.expression(node.args[0])} & 15) == {self.program.own_kind_number(kind.value)}"
        if not self.program.is_base_method(name):
            return self._author_call(node, *self.program.find_method(self, node, name))
        if node.keywords:
            self.refuse(node, f"self.{name} with names of arguments", "give them in order")
        arguments = [self.expression(argument) for argument in node.args]
        place = self.place(node)
        bodies = self.program.bodies
        match name, len(arguments):
            case "draw", 2:
                return self.mark_draw(f"rt.draw(c, {place}, {arguments[0]}, {arguments[1]})")
            case "code_at", 2:
                return f"rt.code_at(c, {arguments[0]}, {arguments[1]})"
            case "put", 3:
                return f"rt.put(c, {place}, {', '.join(arguments)})[0]"
            case "remove", 2:
                return f"rt.remove(c, {', '.join(arguments)})"
            case "move", 3:
                return f"rt.move(c, {bodies}, {', '.join(arguments)})"
            case "body", 1:
                return f"rt.body(c, {place}, {bodies}, {arguments[0]})"
        self.refuse(node, f"self.{name}(...)", "docs/grid-worlds.md lists what rules may call")

    def _super_call(self, node: ast.Call, name: str, owner: type | None) -> str:
        return self._author_call(node, *self.program.find_method(self, node, name, after=owner))

    def _constant_call(self, node: ast.Call, callee: Any) -> str:
        """Return the translation of a call of ``callee``, a function that the name in the call refers to."""
        if isinstance(callee, ObjectKind) or callee in ITEM_FUNCTIONS:
            return self._item(node, callee)
        if isinstance(callee, FunctionType) and not str(callee.__module__).startswith("minihuman.worlds."):
            return self._author_call(node, callee, None)
        place = self.place(node)
        if id(callee) in CODE_FUNCTIONS and not node.keywords:
            arguments = [self._argument_text(argument) for argument in node.args]
            text = CODE_FUNCTIONS[id(callee)].format(*arguments, place=place)
            return self.mark_draw(text) if "rt.draw" in text else text
        if callee in _MATH:
            is_whole = callee in (math.floor, math.ceil)
            text = f"{_MATH[callee]}({self.expression(node.args[0])})"
            return f"rt.whole(c, {place}, {text})" if is_whole else text
        self.refuse(node, f"a call of {ast.unparse(node.func)}", self._suggest_instead(callee))

    def _argument_text(self, node: ast.expr) -> str:
        """Return an argument's translation, in which the generator is the address of its state."""
        symbol = self.symbol(node)
        if symbol is not None and symbol.kind == "rng":
            return "rt.rng_state(c)"
        return self.expression(node)

    @staticmethod
    def _suggest_instead(callee: Any) -> str:
        """Return the advice for a call of ``callee`` that cannot be translated."""
        if getattr(callee, "__module__", "") == "math":
            return "write it with + - * / and sqrt, which are the same on every machine"
        return "docs/grid-worlds.md lists what rules may call"

    def _author_call(self, node: ast.Call, function: FunctionType, owner: type | None) -> str:
        """Return the translation of a call of an author's function; ``owner`` is its class, None outside a class.

        Arguments that stand for ``self``, the grid and the like are fixed in the translated function, which therefore
        takes only the others.
        """
        self_arguments: list[Any] = [] if owner is None else [SELF]
        parameters = function.__code__.co_varnames[
            : function.__code__.co_argcount + function.__code__.co_kwonlyargcount
        ]
        arguments: dict[str, Any] = dict(zip(parameters, [*self_arguments, *node.args], strict=False))
        arguments |= {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
        defaults = self._defaults(function)
        symbols: dict[str, Symbol] = {}
        texts = []
        for name in parameters:
            if name not in arguments and name not in defaults:
                self.refuse(node, f"a call without the argument {name}", "give it")
            argument = arguments.get(name, Symbol("constant", defaults.get(name)))
            symbol = argument if isinstance(argument, Symbol) else self.symbol(argument)
            if symbol is not None and (symbol.kind != "constant" or self.program.constant(symbol.value) is None):
                symbols[name] = symbol
            elif isinstance(argument, Symbol):
                texts.append(self._symbol_text(node, argument))
            else:
                texts.append(self.expression(argument))
        callee = self.program.function(self, node, function, owner, symbols)
        return f"{callee}({', '.join(['c', *texts])})"

    @staticmethod
    def _defaults(function: FunctionType) -> Mapping[str, Any]:
        """Return a function's default arguments by name."""
        names = function.__code__.co_varnames[: function.__code__.co_argcount]
        defaults = function.__defaults__ or ()
        by_position = dict(zip(names[len(names) - len(defaults) :], defaults, strict=True))
        return by_position | (function.__kwdefaults__ or {})
