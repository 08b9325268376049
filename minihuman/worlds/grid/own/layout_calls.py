"""Items, and calls of `Layout`'s methods, in an author's rules."""

import ast
from collections.abc import Mapping
from typing import Any

from minihuman.worlds.grid.layout import MOST_TRIES, from_text
from minihuman.worlds.grid.own.expressions import Expressions
from minihuman.worlds.grid.own.source_names import GRID, Symbol, item_numbers

_GREY_WALL = (2, 5, 0, 0, -1, -1, -1, -1)  # the numbers of a wall, as `item_numbers` lists them
_NAMED_ONLY = 9  # the position of arguments that are given by name only; no call has so many


class LayoutCalls(Expressions):
    """The translation of items and of calls of a layout's methods."""

    def _item(self, node: ast.Call, callee: Any) -> str:
        """Return the translation of a call that makes an item.

        It is a constant if all arguments are constants, or else the item's numbers with a colour that is looked up.
        """
        symbols = [self.symbol(argument) for argument in node.args]
        named = {keyword.arg: self.symbol(keyword.value) for keyword in node.keywords if keyword.arg}
        all_symbols = [*symbols, *named.values()]
        if all(symbol is not None and symbol.kind == "constant" for symbol in all_symbols):
            try:
                options = {name: symbol.value for name, symbol in named.items() if symbol is not None}
                thing = callee(*(symbol.value for symbol in symbols if symbol is not None), **options)
            except TypeError as error:
                self.refuse(node, f"{ast.unparse(node)}: {error}", "correct the call")
            return self._symbol_text(node, Symbol("constant", thing))
        return self._coloured_item(node, callee, named)

    def _coloured_item(self, node: ast.Call, callee: Any, named: Mapping[str, Symbol | None]) -> str:
        """Return the translation of a call of ``callee`` that makes an item whose colour or contents are computed.

        ``named`` has the meanings of the arguments that are given by name.
        """
        by_name = {keyword.arg: keyword.value for keyword in node.keywords}
        colour = node.args[0] if node.args else by_name.get("colour")
        contents = node.args[1] if len(node.args) > 1 else by_name.get("contains")
        options = {
            name: symbol.value
            for name, symbol in named.items()
            if symbol is not None and name not in ("colour", "contains")
        }
        if len(options) + ("colour" in named) + ("contains" in named) != len(named):
            self.refuse(node, "an item with a computed state", "write one call for each state, in an if")
        numbers = item_numbers(callee("red", **options), self.program.kind_number)
        colour_text = "0" if colour is None else self._colour(colour)
        inside = "(-1, -1, -1, -1)" if contents is None else f"{self.expression(contents)}[:4]"
        return f"(({numbers[0]}, {colour_text}, {numbers[2]}, {numbers[3]}) + {inside})"

    def _colour(self, node: ast.AST) -> str:
        """Return the translation of a colour's name, looked up in the program's table of colours."""
        self.program.needs_colours = True
        return f"rt.colour_number(c, {self.place(node)}, {self.expression(node)}, COLOURS)"

    def _argument(self, node: ast.Call, nth: int, name: str, default: str) -> str:
        """Return the translation of a call's argument, given at position ``nth`` or by name, or else ``default``."""
        if nth < len(node.args):
            return self.expression(node.args[nth])
        for keyword in node.keywords:
            if keyword.arg == name:
                return self.expression(keyword.value)
        return default

    def _layout_call(self, node: ast.Call, name: str) -> str:
        """Return the translation of a call of a layout's method, made by the method here that is named after it."""
        method = getattr(self, f"_grid_{name}", None)
        if method is None:
            self.refuse(node, f"grid.{name}(...)", "docs/grid-worlds.md lists what a layout may call")
        text: str = method(node, self.place(node))
        return text

    def _grid_wall_rect(self, node: ast.Call, place: int) -> str:
        x = self._argument(node, 0, "x", "0")
        y = self._argument(node, 1, "y", "0")
        w = self._argument(node, 2, "width", f"(rt.width(c) - {x})")
        h = self._argument(node, 3, "height", f"(rt.height(c) - {y})")
        return f"rt.wall_rect(c, {place}, {x}, {y}, {w}, {h})"

    def _translate_line(self, node: ast.Call, place: int, dx: int) -> str:
        """Return the translation of a call that puts items along a line.

        Args:
            node: the call.
            place: the number of the call's place in the rules.
            dx: 1 for a row, 0 for a column.
        """
        x = self._argument(node, 0, "x", "0")
        y = self._argument(node, 1, "y", "0")
        to_edge = f"(rt.width(c) - {x})" if dx else f"(rt.height(c) - {y})"
        length = self._argument(node, 2, "length", to_edge)
        item_text = self._argument(node, 3, "item", repr(_GREY_WALL))
        if "None" in (length, item_text):
            self.refuse(node, "None as an argument", "leave it out")
        return f"rt.put_line(c, {place}, {item_text}, {x}, {y}, {dx}, {1 - dx}, {length})"

    def _grid_across(self, node: ast.Call, place: int) -> str:
        return self._translate_line(node, place, 1)

    def _grid_down(self, node: ast.Call, place: int) -> str:
        return self._translate_line(node, place, 0)

    def _grid_put(self, node: ast.Call, place: int) -> str:
        parts = [self._argument(node, nth, name, "0") for nth, name in enumerate(("item", "x", "y"))]
        return f"rt.put(c, {place}, {', '.join(parts)})"

    def _grid_clear(self, node: ast.Call, place: int) -> str:
        return f"rt.clear_cell(c, {place}, {self._argument(node, 0, 'x', '0')}, {self._argument(node, 1, 'y', '0')})"

    def _rectangle(self, node: ast.Call) -> str:
        """Return the translations of a rectangle's top left cell and size; by default it is the whole grid."""
        size = self._argument(node, _NAMED_ONLY, "size", "None")
        if size == "None":
            size = "(rt.width(c), rt.height(c))"
        return f"{self._argument(node, _NAMED_ONLY, 'top', '(0, 0)')}, {size}"

    def _grid_place(self, node: ast.Call, place: int) -> str:
        """Return the translation of a call that places an item in a random cell."""
        item_text = self._argument(node, 0, "item", "0")
        tries = self._argument(node, _NAMED_ONLY, "tries", str(MOST_TRIES))
        reject = next((keyword.value for keyword in node.keywords if keyword.arg == "reject"), None)
        symbol = None if reject is None else self.symbol(reject)
        if reject is None or (symbol is not None and symbol.kind == "constant" and symbol.value is None):
            return self.mark_draw(
                f"rt.place_item(c, {place}, {self.program.bodies}, {item_text}, {self._rectangle(node)}, {tries})"
            )
        placing, captured = self.program.placement(self, node, reject)
        arguments = ", ".join(["c", str(place), item_text, self._rectangle(node), tries, *captured])
        return self.mark_draw(f"{placing}({arguments})")

    def _grid_put_agent(self, node: ast.Call, place: int) -> str:
        parts = [self._argument(node, nth, name, "0") for nth, name in enumerate(("x", "y", "direction"))]
        body = self._argument(node, _NAMED_ONLY, "body", "0")
        return f"rt.put_agent(c, {place}, {self.program.bodies}, {', '.join(parts)}, {body})"

    def _grid_place_agent(self, node: ast.Call, place: int) -> str:
        direction = self._argument(node, _NAMED_ONLY, "direction", "-1")
        direction = "-1" if direction == "None" else direction
        body = self._argument(node, _NAMED_ONLY, "body", "0")
        arguments = f"{self._rectangle(node)}, {direction}, {body}"
        return self.mark_draw(f"rt.place_agent(c, {place}, {self.program.bodies}, {arguments})")

    def _grid_integer(self, node: ast.Call, place: int) -> str:
        low = self._argument(node, 0, "low", "0")
        return self.mark_draw(f"rt.draw(c, {place}, {low}, {self._argument(node, 1, 'high', '0')})")

    def _grid_choice(self, node: ast.Call, place: int) -> str:
        options = node.args[0]
        if isinstance(options, ast.List):
            options = ast.copy_location(ast.Tuple(options.elts, ast.Load()), options)
        return self.mark_draw(f"rt.choice(c, {place}, {self.expression(options)})")

    def _grid_task(self, node: ast.Call, place: int) -> str:
        arguments = [self.expression(argument) for argument in node.args]
        return "(" + "".join(f"rt.set_task(c, {nth}, {text}), " for nth, text in enumerate(arguments)) + ")"

    def diagram(self, node: ast.Call) -> list[str] | None:
        """Return the statements of a call ``from_text("...", grid)``; None for any other call."""
        callee = self.symbol(node.func)
        if callee is None or callee.kind != "constant" or callee.value is not from_text:
            return None
        symbols = [self.symbol(argument) for argument in node.args]
        if len(symbols) != 2 or symbols[0] is None or not isinstance(symbols[0].value, str) or symbols[1] != GRID:
            self.refuse(node, "from_text with a computed diagram", "name a constant")
        return self.program.diagram(symbols[0].value, self.place(node))
