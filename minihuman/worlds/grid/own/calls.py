"""Python's built-in functions in an author's rules: `range`, `any` over a generator, `tuple`, and the like."""

import ast
from typing import Any

from minihuman.worlds.grid.own.layout_calls import LayoutCalls
from minihuman.worlds.grid.own.source_names import Symbol

_PLAIN = {min: "min", max: "max", bool: "bool", len: "len", range: "range", enumerate: "enumerate"}
_PLAIN |= {zip: "zip"}
_CHECKED = {abs: "absolute", int: "whole", float: "real", round: "rounded"}


class Calls(LayoutCalls):
    """The translation of calls of Python's built-in functions, and of generators and lambdas."""

    def _constant_call(self, node: ast.Call, callee: Any) -> str:
        """Return the translation of a call of ``callee``, which may be a built-in function of Python."""
        try:
            is_built_in = callee in _PLAIN or callee in _CHECKED or callee in (any, all, sum, divmod, tuple, list)
        except TypeError:  # it cannot be hashed
            is_built_in = False
        if not is_built_in:
            return super()._constant_call(node, callee)
        if node.keywords:
            self.refuse(node, f"{callee.__name__} with named arguments", "give them in order")
        if callee in (any, all, sum):
            return self._over_generator(node, callee)
        if callee is tuple:
            return self._translate_tuple_call(node)
        if callee is list:
            self.refuse(node, "a list here", "give the list a name of its own: values = list(rewards)")
        arguments = [self.expression(argument) for argument in node.args]
        if callee in _CHECKED:
            if len(arguments) != 1:
                self.refuse(node, f"{callee.__name__} with {len(arguments)} arguments", "give one")
            return f"rt.{_CHECKED[callee]}(c, {self.place(node)}, {arguments[0]})"
        if callee is divmod:
            place = self.place(node)
            first, second = arguments
            return f"(rt.floordiv(c, {place}, {first}, {second}), rt.mod(c, {place}, {first}, {second}))"
        if callee in (min, max) and len(arguments) == 1:
            return self._over_generator(node, callee)
        return f"{_PLAIN[callee]}({', '.join(arguments)})"

    def _over_generator(self, node: ast.Call, callee: Any) -> str:
        """Return the translation of ``any``, ``all``, ``sum``, ``min`` or ``max`` over a generator or a sequence."""
        argument = node.args[0]
        if not isinstance(argument, ast.GeneratorExp | ast.ListComp):
            if callee in (min, max):
                self.refuse(
                    node, f"{callee.__name__} of one argument", "give it the numbers one by one, or a generator"
                )
            # the sequence becomes a generator over it
            elements = ast.parse("(_element for _element in ())", mode="eval").body
            assert isinstance(elements, ast.GeneratorExp)
            for part in ast.walk(elements):
                ast.copy_location(part, node)
            elements.generators[0].iter = argument
            argument = elements
        lifted, captured = self.program.lift_generator(self, argument, callee)
        return f"{lifted}({', '.join(['c', *captured])})"

    def _translate_tuple_call(self, node: ast.Call) -> str:
        """Return the translation of ``tuple(...)`` of a local list, a generator over a constant, or another tuple."""
        argument = node.args[0]
        if isinstance(argument, ast.Name) and argument.id in self.lengths:
            place = self.place(node)
            elements = (f"rt.at(c, {place}, v_{argument.id}, {k}), " for k in range(self.lengths[argument.id]))
            return "(" + "".join(elements) + ")"
        if isinstance(argument, ast.GeneratorExp | ast.ListComp):
            return self._unrolled(node, argument)
        return self.expression(argument)

    def _unrolled(self, node: ast.Call, generator: ast.GeneratorExp | ast.ListComp) -> str:
        """Return the tuple that a generator over a constant yields, with each element translated separately."""
        clause = generator.generators[0]
        values = self._constant_values(clause.iter)
        is_simple = len(generator.generators) == 1 and not clause.ifs and isinstance(clause.target, ast.Name)
        if values is None or not is_simple:
            self.refuse(node, "a tuple of computed length", "use an IntArray field, or range(...) of a constant")
        assert isinstance(clause.target, ast.Name)
        texts = []
        before = self.symbols.get(clause.target.id)
        for constant in values:
            self.symbols[clause.target.id] = Symbol("constant", constant)
            texts.append(self.expression(generator.elt))
        self.symbols.pop(clause.target.id)
        if before is not None:
            self.symbols[clause.target.id] = before
        return "(" + "".join(f"{text}, " for text in texts) + ")"

    def _constant_values(self, node: ast.AST) -> tuple[Any, ...] | None:
        """Return the values of a constant tuple or of a range of constants; None if they are computed."""
        symbol = self.symbol(node)
        if symbol is not None and isinstance(symbol.value, tuple | list | range):
            return tuple(symbol.value)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range":
            ends = [self.symbol(argument) for argument in node.args]
            if all(end is not None and isinstance(end.value, int) for end in ends):
                return tuple(range(*(end.value for end in ends if end is not None)))
        return None
