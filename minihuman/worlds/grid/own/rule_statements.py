"""Statements of an author's rules, as lines of the translated source; and what each function returns."""

import ast
from collections.abc import Iterable
from types import FunctionType
from typing import Any

from minihuman.worlds.grid.own.calls import Calls
from minihuman.worlds.grid.own.fields import Bool, Float, Int, IntTuple, OwnField
from minihuman.worlds.grid.own.source_names import FunctionSource, Symbol

_INDENT = "    "


class Statements(Calls):
    """The translation of one function of an author's.

    Args:
        program: the translation of the whole world.
        function: the function.
        owner: the class in which it is defined; None for a function of a module.
        source: its syntax tree.
        symbols: the parameters that stand for `self`, `grid` and such.
        variables: the names that are bound besides those that the body binds.
        returns: what its results are: "reward", "rewards" (of a team), or "any".
    """

    def __init__(
        self,
        program: Any,
        function: FunctionType,
        owner: type | None,
        source: FunctionSource,
        symbols: dict[str, Symbol],
        variables: Iterable[str],
        returns: str = "any",
    ) -> None:
        self.program = program
        self.function = function
        self.owner = owner
        self.source = source
        self.symbols = dict(symbols)
        self.variables = set(variables) - symbols.keys()
        self.lengths: dict[str, int] = {}
        self.returns = returns
        self.lines: list[tuple[str, int]] = []  # text and the place it came from
        self._depth = 1
        self._temporaries = 0

    def emit(self, text: str, node: ast.AST) -> None:
        """Add a line to the translated function, indented, with the place of the node that it translates."""
        self.lines.append((_INDENT * self._depth + text, self.place(node)))

    def body(self, statements: Iterable[ast.stmt]) -> None:
        """Translate statements one after the other; refuse a statement of a kind that cannot be translated."""
        for statement in statements:
            method = getattr(self, f"_translate_{type(statement).__name__.lower()}", None)
            if method is None:
                name = type(statement).__name__
                self.refuse(statement, f"a statement of the kind {name}", "use assignments, if, for, while and return")
            method(statement)

    def block(self, statements: Iterable[ast.stmt], node: ast.AST) -> None:
        """Translate the statements of an indented block, as ``pass`` if nothing results."""
        self._depth += 1
        before = len(self.lines)
        self.body(statements)
        if len(self.lines) == before:
            self.emit("pass", node)
        self._depth -= 1

    def _translate_pass(self, node: ast.Pass) -> None:
        self.emit("pass", node)

    def _translate_break(self, node: ast.Break) -> None:
        self.emit("break", node)

    def _translate_continue(self, node: ast.Continue) -> None:
        self.emit("continue", node)

    def _translate_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return  # a docstring
        if isinstance(node.value, ast.Call):
            lines = self.diagram(node.value)
            if lines is not None:
                for line in lines:
                    self.emit(line, node)
                return
        self.emit(self.expression(node.value), node)

    def _translate_return(self, node: ast.Return) -> None:
        """Translate a return; that of `reward_and_done` also converts its results to floats and a truth value."""
        if self.returns == "any":
            self.emit("return" if node.value is None else f"return {self.expression(node.value)}", node)
        elif node.value is None:
            self.refuse(node, "a return without a reward and an end", "return reward, terminated")
        else:
            self._return_reward(node.value, node)

    def _return_reward(self, right_side: ast.expr, node: ast.AST) -> None:
        """Translate the return of a reward and an end; a conditional expression becomes an if with two returns."""
        if isinstance(right_side, ast.IfExp):
            self.emit(f"if {self.expression(right_side.test)}:", node)
            self._depth += 1
            self._return_reward(right_side.body, node)
            self._depth -= 1
            self._return_reward(right_side.orelse, node)
            return
        if isinstance(right_side, ast.Tuple) and len(right_side.elts) == 2:
            reward, ended = (self.expression(element) for element in right_side.elts)
        else:
            self.emit(f"_pair = {self.expression(right_side)}", node)
            reward, ended = "_pair[0]", "_pair[1]"
        if self.returns == "reward":
            self.emit(f"return rt.real(c, {self.place(node)}, {reward}), bool({ended})", node)
            return
        self.emit(f"_rewards = {reward}", node)
        floats = "".join(f"rt.real(c, {self.place(node)}, _rewards[{body}]), " for body in range(self.program.bodies))
        self.emit(f"return ({floats}), bool({ended})", node)

    # --- assignments ---

    def _translate_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._translate_assign(ast.copy_location(ast.Assign([node.target], node.value), node))

    def _translate_assign(self, node: ast.Assign) -> None:
        if len(node.targets) > 1:
            name = self._new_temporary()
            self.emit(f"{name} = {self.expression(node.value)}", node)
            for target in node.targets:
                self._assign_text(target, name, node)
            return
        target = node.targets[0]
        if isinstance(target, ast.Name) and self._assign_name(target, node.value, node):
            return
        if isinstance(target, ast.Attribute) and self._assign_mission(target, node.value):
            return
        if isinstance(target, ast.Tuple | ast.List):
            self._assign_tuple(target, node.value, node)
            return
        self._assign_text(target, self.expression(node.value), node)

    def _assign_name(self, target: ast.Name, right_side: ast.expr, node: ast.AST) -> bool:
        """Translate ``name = ...`` with an alias of the state, or a list, and return True; return False for others."""
        symbol = self.symbol(right_side)
        if symbol is not None and symbol.kind != "constant":
            self.symbols[target.id] = symbol
            self.variables.discard(target.id)
            return True
        return self._assign_list(target, right_side, node)

    def _assign_list(self, target: ast.Name, right_side: ast.expr, node: ast.AST) -> bool:
        """Translate the assignment of a new list, as an array in scratch memory, and return True; else return False."""
        match right_side:
            case ast.List():
                length = len(right_side.elts)
                elements = "(" + "".join(f"{self.expression(element)}, " for element in right_side.elts) + ")"
            case ast.BinOp(left=ast.List() as repeated, op=ast.Mult(), right=times):
                length, elements = self._read_repeated_list(repeated, times, node)
            case ast.Call(func=ast.Name(id="list")):
                length = self.program.bodies
                elements = self.expression(right_side.args[0])
            case _:
                return False
        if length == 0:
            self.refuse(node, "an empty list", "declare an IntArray field and a count")
        array = self.program.scratch(length, is_float=self._has_floats(right_side))
        self.lengths[target.id] = length
        self.emit(f"v_{target.id} = {array}", node)
        self.emit(f"rt.copy_into(c, {self.place(node)}, v_{target.id}, {elements})", node)
        return True

    def _read_repeated_list(self, elements: ast.List, times: ast.expr, node: ast.AST) -> tuple[int, str]:
        """Return the length of ``[element] * times`` and the element's translation; refuse a computed length."""
        count = self.symbol(times)
        if count is None or not isinstance(count.value, int) or len(elements.elts) != 1:
            self.refuse(node, "a list of computed length", "declare an IntArray or FloatArray field")
        return count.value, self.expression(elements.elts[0])

    def _has_floats(self, right_side: ast.expr) -> bool:
        """Return whether a list is taken to hold floats: if it has a float constant, or a name with "reward" in it."""
        parts = list(ast.walk(right_side))
        has_float_constant = any(isinstance(part, ast.Constant) and isinstance(part.value, float) for part in parts)
        return has_float_constant or any(isinstance(part, ast.Name) and "reward" in part.id for part in parts)

    def _assign_mission(self, target: ast.Attribute, right_side: ast.expr) -> bool:
        """Translate an assignment to ``grid.mission`` and return True; return False for another target."""
        base = self.symbol(target.value)
        if base is None or base.kind != "grid" or target.attr != "mission":
            return False
        parts = right_side.values if isinstance(right_side, ast.JoinedStr) else [right_side]
        template: list[str | None] = []  # None is a placeholder
        for part in parts:
            if isinstance(part, ast.Constant) and isinstance(part.value, str):
                template.append(part.value)
                continue
            place = self.place(right_side)
            placeholder = template.count(None)
            content = self._read_placeholder(part, right_side)
            self.emit(f"rt.text_part(c, {place}, {placeholder}, {content})", right_side)
            template.append(None)
        self.emit(f"rt.mission(c)[0] = {self.program.number_template(tuple(template))}", right_side)
        return True

    def _read_placeholder(self, part: ast.expr, mission: ast.expr) -> str:
        """Return the translation of the expression in a mission's placeholder; refuse a placeholder with a format."""
        if not isinstance(part, ast.FormattedValue):
            return self.expression(part)
        if part.format_spec is not None or part.conversion != -1:
            self.refuse(mission, "a placeholder with a format", "write {name} alone")
        return self.expression(part.value)

    def _assign_tuple(self, target: ast.Tuple | ast.List, right_side: ast.expr, node: ast.AST) -> None:
        """Translate an assignment to several targets, after all elements of the right side are computed."""
        count = len(target.elts)
        if isinstance(right_side, ast.Tuple) and len(right_side.elts) == count:
            names = [self._new_temporary() for _ in range(count)]
            for name, element in zip(names, right_side.elts, strict=True):
                self.emit(f"{name} = {self.expression(element)}", node)
        else:
            text = self.expression(right_side)
            if count in (2, 3):
                text = f"rt.unpack_{count}(c, {self.place(node)}, {text})"
            names = [self._new_temporary() for _ in range(count)]
            self.emit(f"{', '.join(names)} = {text}", node)
        for element, name in zip(target.elts, names, strict=True):
            self._assign_text(element, name, node)

    def _new_temporary(self) -> str:
        self._temporaries += 1
        return f"_t{self._temporaries}"

    def _assign_text(self, target: ast.expr, text: str, node: ast.AST) -> None:
        """Translate the assignment of ``text``, a translated expression; a name with a meaning becomes a variable."""
        place = self.place(node)
        if isinstance(target, ast.Name):
            self.symbols.pop(target.id, None)
            self.variables.add(target.id)
            self.emit(f"v_{target.id} = {text}", node)
        elif isinstance(target, ast.Attribute):
            self._assign_attribute(target, text, node)
        elif isinstance(target, ast.Subscript):
            self._assign_element(target, text, place, node)
        elif isinstance(target, ast.Tuple | ast.List):
            names = [self._new_temporary() for _ in target.elts]
            elements = f"rt.unpack_{len(names)}(c, {place}, {text})" if len(names) in (2, 3) else text
            self.emit(f"{', '.join(names)} = {elements}", node)
            for element, name in zip(target.elts, names, strict=True):
                self._assign_text(element, name, node)
        else:
            self.refuse(node, "this target of an assignment", "assign to a name, a field or an element")

    def _assign_attribute(self, target: ast.Attribute, text: str, node: ast.AST) -> None:
        base = self.symbol(target.value)
        field = self.program.fields.get(target.attr) if base is not None and base.kind == "self" else None
        if field is None:
            name = target.attr
            self.refuse(node, f"an assignment to {ast.unparse(target)}", f"declare it in the class: {name} = Int()")
        self._assign_field(field, text, node)

    def _assign_field(self, field: OwnField, text: str, node: ast.AST) -> None:
        place = self.place(node)
        offset = field.offset
        if isinstance(field, Bool):
            self.emit(f"rt.own(c)[{offset}] = 1 if {text} else 0", node)
        elif isinstance(field, Int):
            self.emit(f"rt.own(c)[{offset}] = rt.declared_whole(c, {place}, {text})", node)
        elif isinstance(field, Float):
            self.emit(f"rt.own_floats(c)[{offset}] = rt.real(c, {place}, {text})", node)
        elif isinstance(field, IntTuple):
            self.emit(f"rt.copy_into(c, {place}, rt.view_1(rt.own(c), {offset}, {field.size}), {text})", node)
        else:
            self.emit(f"rt.copy_into(c, {place}, {self._field(field)}, {text})", node)

    def _assign_element(self, target: ast.Subscript, text: str, place: int, node: ast.AST) -> None:
        """Translate the assignment of ``text`` to an element, a row or all elements of an array."""
        values = self.expression(target.value)
        if isinstance(target.slice, ast.Slice):
            if any((target.slice.lower, target.slice.upper, target.slice.step)):
                self.refuse(
                    node, "an assignment to a slice with ends", "assign the elements one by one, or all with [:]"
                )
            self.emit(f"rt.copy_into(c, {place}, {values}, {text})", node)
        elif isinstance(target.slice, ast.Tuple):
            i, j = self._pair(target)
            self.emit(f"rt.set_at_2(c, {place}, {values}, {i}, {j}, {text})", node)
        else:
            self.emit(f"rt.set_at(c, {place}, {values}, {self.expression(target.slice)}, {text})", node)

    def _translate_augassign(self, node: ast.AugAssign) -> None:
        """Translate an operation on a target, such as ``+=``; the indices of an element are computed once."""
        target = node.target
        if isinstance(target, ast.Subscript):
            indices = target.slice.elts if isinstance(target.slice, ast.Tuple) else [target.slice]
            if isinstance(target.slice, ast.Slice):
                self.refuse(node, "an operation on a slice", "use a loop")
            names = []
            for index in indices:
                name = f"index{self._temporaries}"
                self._temporaries += 1
                self.emit(f"v_{name} = {self.expression(index)}", node)
                self.variables.add(name)
                names.append(ast.copy_location(ast.Name(name, ast.Load()), node))
            index_node: ast.expr = names[0] if len(names) == 1 else ast.Tuple(list(names), ast.Load())
            target = ast.fix_missing_locations(
                ast.copy_location(ast.Subscript(target.value, index_node, ast.Load()), node)
            )
        text = self.operation(node, node.op, self.expression(target), self.expression(node.value))
        self._assign_text(target, text, node)

    # --- control ---

    def _translate_if(self, node: ast.If) -> None:
        self.emit(f"if {self.expression(node.test)}:", node)
        self.block(node.body, node)
        if node.orelse:
            self.emit("else:", node)
            self.block(node.orelse, node)

    def _translate_while(self, node: ast.While) -> None:
        if node.orelse:
            self.refuse(node, "else after while", "set a variable before break")
        self.emit(f"while {self.expression(node.test)}:", node)
        self.block(node.body, node)

    def _translate_for(self, node: ast.For) -> None:
        if node.orelse:
            self.refuse(node, "else after for", "set a variable before break")
        self.loop(node.target, node.iter, node)
        self._depth += 1
        self._bind_targets(node)
        self._depth -= 1
        self.block(node.body, node)

    def loop(self, target: ast.expr, iterated: ast.expr, node: ast.AST) -> None:
        """Add the head of a loop to the translation; `_bind_targets` then assigns its element to the target."""
        self._temporaries += 1
        name = f"_e{self._temporaries}"
        self._elements = (target, name)
        field = self.matrix_field(iterated)
        if field is not None:
            self.emit(f"for {name}_row in range({field.shape[0]}):", node)
            self._elements = (target, f"rt.row_of(c, {self.place(node)}, {self._field(field)}, {name}_row)")
            return
        self.emit(f"for {name} in {self.expression(iterated)}:", node)

    def _bind_targets(self, node: ast.AST) -> None:
        """Translate the assignment of the latest loop's element to that loop's target."""
        target, text = self._elements
        self._assign_text(target, text, node)
