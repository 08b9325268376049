"""The translation of a world's `layout` and `reward_and_done` into one source that Numba compiles.

Every function of the translated source takes the address of a context (see `context`), through which it finds the row
of state; the declared fields as int64 and, on the same memory, as float64; settings as int64 and as float64; the random
stream; the record of a fault; the mission's parts; and scratch memory for short lists, as int64 and as float64.
"""

import ast
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core.state import FIRST_OWN_KIND
from minihuman.worlds.grid.layout import from_text
from minihuman.worlds.grid.object_kinds import Item, ObjectKind
from minihuman.worlds.grid.own.entries import format_entries
from minihuman.worlds.grid.own.faults import NO_PLACE, UNPACK
from minihuman.worlds.grid.own.fields import numbers_length
from minihuman.worlds.grid.own.rule_statements import Statements
from minihuman.worlds.grid.own.source_names import (
    GRID,
    SELF,
    FunctionSource,
    Symbol,
    TranslationError,
    format_constant,
    item_numbers,
    number_kind,
    read_function,
)

_OURS = "minihuman."
SCRATCH_NUMBERS = 4096  # of a world's short lists


@dataclass(frozen=True, slots=True)
class Program:
    """A world's rules as translated source.

    Args:
        text: the source; it names no file.
        lines: for each line of the source, the number of the place from which it came; -1 for none.
        places: by number, places in the author's source: a file and a line.
        texts: by number, the texts that rules use.
        templates: by number, missions; None stands for a part that the rules fill in.
        settings: attributes that the rules read as whole numbers, from each world anew.
        float_settings: attributes that they read as floats, likewise.
        fixed: attributes that are part of the source, with their values.
        has_layout: whether the layout is translated.
        has_reward: whether `reward_and_done` is translated.
        draws: whether the rules draw random numbers.
        scratch: how many numbers of scratch memory they need.
        mission_length: how many numbers record a mission: its template, and two for each placeholder.
    """

    text: str
    lines: tuple[int, ...]
    places: tuple[tuple[str, int], ...]
    texts: tuple[str, ...]
    templates: tuple[tuple[str | None, ...], ...]
    settings: tuple[str, ...]
    float_settings: tuple[str, ...]
    fixed: Mapping[str, Any]
    has_layout: bool
    has_reward: bool
    draws: bool
    scratch: int
    mission_length: int = field(default=1)

    def place(self, number: int) -> str:
        """Return the place with a number as ``file:line``; for -1, "the compiled rules"."""
        if not 0 <= number < len(self.places):
            return "the compiled rules"
        path, line = self.places[number]
        return f"{path}:{line}"


class Translation:
    """The translation of one world's rules while it is made."""

    def __init__(self, world: Any) -> None:
        self.world = world
        self.fields = {declared.name: declared for declared in type(world).own_fields}
        self.bodies = int(getattr(world, "bodies", 1))
        self.is_team = hasattr(world, "idle_action")
        self.draws = False
        self.needs_colours = False
        self._places: dict[tuple[str, int], int] = {}
        self._texts: list[str] = []
        self._templates: list[tuple[str | None, ...]] = []
        self._settings: list[str] = []
        self._float_settings: list[str] = []
        self._fixed: dict[str, Any] = {}
        self._functions: dict[Any, str] = {}
        self._lines: list[tuple[str, int]] = []
        self._count = 0
        self._scratch = 0

    def translate(self) -> Program:
        """Return the translated rules.

        Raises:
            TranslationError: if something cannot be translated.
        """
        layout = self._translate_method("layout", {"self": SELF, "grid": GRID}, "any")
        rule = None
        if type(self.world)._has_own_reward:
            rule = self._translate_method("reward_and_done", {"self": SELF}, "rewards" if self.is_team else "reward")
        mission_length = 1 + 2 * max([0, *(template.count(None) for template in self._templates)])
        lengths = {
            "own": numbers_length(type(self.world)),
            "settings": len(self._settings),
            "floats": len(self._float_settings),
            "scratch": self._scratch,
            "mission": mission_length,
        }
        head = []
        if self.needs_colours:
            numbers = [COLOURS.index(text) if text in COLOURS else -1 for text in self._texts]
            head.append(("COLOURS = (" + "".join(f"{number}, " for number in numbers) + ")", -1))
        entries = format_entries(layout=layout, rule=rule, bodies=self.bodies, is_team=self.is_team, lengths=lengths)
        lines = [*head, *self._lines, *((line, -1) for line in entries)]
        return Program(
            text="\n".join(text for text, _ in lines) + "\n",
            lines=tuple(place for _, place in lines),
            places=tuple(self._places),
            texts=tuple(self._texts),
            templates=tuple(self._templates),
            settings=tuple(self._settings),
            float_settings=tuple(self._float_settings),
            fixed=dict(self._fixed),
            has_layout=True,
            has_reward=rule is not None,
            draws=self.draws,
            scratch=self._scratch,
            mission_length=mission_length,
        )

    def _translate_method(self, name: str, symbols: dict[str, Symbol], returns: str) -> str:
        """Translate one of the world's methods, and return the name of the translated function.

        The symbols are the meanings of its first parameters in order, whatever the author calls these. ``returns`` is
        as in `Statements`.
        """
        function, owner = self._look_up(name, None)
        source = read_function(function)
        parameters = [argument.arg for argument in source.node.args.args]
        parameter_symbols = dict(zip(parameters, symbols.values(), strict=False))
        return self._translate_function(function, owner, source, parameter_symbols, returns)

    def _translate_function(
        self,
        function: FunctionType,
        owner: type | None,
        source: FunctionSource,
        symbols: dict[str, Symbol],
        returns: str = "any",
    ) -> str:
        """Translate an author's function, and return the name of the translated one; parameters as in `Statements`."""
        arguments = source.node.args
        if arguments.vararg or arguments.kwarg or arguments.posonlyargs:
            line = source.node.lineno + source.offset
            raise TranslationError(
                f"{source.path}:{line}: * and / in {source.node.name}'s arguments cannot be translated; name them"
            )
        parameters = [a.arg for a in [*arguments.args, *arguments.kwonlyargs] if a.arg not in symbols]
        bound = {n.id for n in ast.walk(source.node) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
        statements = Statements(self, function, owner, source, symbols, {*parameters, *bound}, returns)
        statements.body(source.node.body)
        name = self._new_name("f")
        self._add_function(name, ["c", *(f"v_{parameter}" for parameter in parameters)], statements.lines)
        return name

    def _new_name(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def _add_function(self, name: str, parameters: Sequence[str], lines: Iterable[tuple[str, int]]) -> None:
        """Add a function to the translated source; ``lines`` has the text of each line and the number of its place."""
        self._lines += [("@rt.njit", -1), (f"def {name}({', '.join(parameters)}):", -1)]
        self._lines += list(lines) or [("    pass", -1)]

    # --- what the translation of a function needs ---

    def number_place(self, path: str, line: int) -> int:
        """Return the number of a place, a file and a line of the author's source; a new place gets a new number."""
        return self._places.setdefault((path, line), len(self._places))

    def constant(self, content: Any) -> str | None:
        """Return a constant as source, or None if rules cannot use it."""
        return format_constant(content, self._texts, self.kind_number)

    def kind_number(self, thing: Item) -> int:
        """Return the number of an item's kind."""
        return number_kind(thing, self.world.kinds)

    def own_kind_number(self, kind: ObjectKind) -> int:
        """Return the number of a kind of the world's own; -1 if the world does not have it."""
        return FIRST_OWN_KIND + self.world.kinds.index(kind) if kind in self.world.kinds else -1

    def fixed_attribute(self, name: str) -> tuple[bool, Any]:
        """Return whether rules treat an attribute of the world as a constant, and if so the constant.

        Such an attribute becomes a part of the source. Numbers that `__init__` sets do not: see `setting`.
        """
        if name in self.fields:
            return False, None
        if name in vars(self.world):
            content = vars(self.world)[name]
            if isinstance(content, bool | int | float) or self.constant(content) is None:
                return False, None
            self._fixed[name] = content
            return True, content
        for owner in type(self.world).__mro__:
            if name in vars(owner):
                content = vars(owner)[name]
                return not (callable(content) or isinstance(content, property | staticmethod | classmethod)), content
        return False, None

    def setting(self, name: str) -> str | None:
        """Return the translated source that reads a number set by `__init__`; None if there is no such number."""
        content = vars(self.world).get(name)
        if isinstance(content, bool | int) and -(2**63) <= content < 2**63:
            if name not in self._settings:
                self._settings.append(name)
            text = f"rt.settings(c)[{self._settings.index(name)}]"
            return f"({text} != 0)" if isinstance(content, bool) else text
        if isinstance(content, float):
            if name not in self._float_settings:
                self._float_settings.append(name)
            return f"rt.float_settings(c)[{self._float_settings.index(name)}]"
        return None

    def property_of(self, name: str) -> tuple[FunctionType, type] | None:
        """Return the function of a property that the author wrote, and its class; None if there is no such property."""
        for owner in type(self.world).__mro__:
            if name in vars(owner):
                content = vars(owner)[name]
                is_own = isinstance(content, property) and not owner.__module__.startswith(_OURS)
                return (content.fget, owner) if is_own else None
        return None

    def is_base_method(self, name: str) -> bool:
        """Return whether a method of the world is defined by this package, not the author; False if there is none."""
        for owner in type(self.world).__mro__:
            if name in vars(owner):
                return owner.__module__.startswith(_OURS)
        return False

    def _look_up(self, name: str, after: type | None) -> tuple[FunctionType, type | None]:
        """Return a method and the class that defines it, searching after a class if one is given.

        The class is None for a static method.

        Raises:
            KeyError: if no class defines the method.
        """
        classes = list(type(self.world).__mro__)
        if after is not None:
            classes = classes[classes.index(after) + 1 :]
        for owner in classes:
            if name in vars(owner):
                content = vars(owner)[name]
                if isinstance(content, staticmethod):
                    function: Any = content.__func__
                    return function, None
                if isinstance(content, FunctionType):
                    return content, owner
                break
        raise KeyError(name)

    def find_method(
        self, caller: Statements, node: ast.AST, name: str, after: type | None = None
    ) -> tuple[FunctionType, type | None]:
        """Return one of the author's methods and the class that defines it; None as the class of a static method.

        Refuse the node, a call in ``caller``, if there is no such method. With ``after``, only classes after it in the
        method resolution order are searched.
        """
        try:
            return self._look_up(name, after)
        except KeyError:
            caller.refuse(node, f"a call of the method {name}", "define it with def in the class")

    def function(
        self,
        caller: Statements,
        node: ast.AST,
        function: FunctionType,
        owner: type | None,
        symbols: dict[str, Symbol],
    ) -> str:
        """Return the name of the translation of an author's function, which is made once for the same symbols.

        Args:
            caller: the translation of the function that calls it.
            node: the call.
            function: the author's function.
            owner: the class in which it is defined; None outside a class.
            symbols: the meanings of the parameters that are not passed as numbers, such as ``self``.
        """
        key = function, tuple(sorted((name, symbol.kind, id(symbol.value)) for name, symbol in symbols.items()))
        if key not in self._functions:
            self._functions[key] = ""
            self._functions[key] = self._translate_function(function, owner, read_function(function), symbols)
        if not self._functions[key]:
            caller.refuse(node, f"{function.__name__}, which calls itself,", "write a loop")
        return self._functions[key]

    def lift_generator(
        self, caller: Statements, generator: ast.GeneratorExp | ast.ListComp, callee: Callable[..., Any]
    ) -> tuple[str, list[str]]:
        """Translate ``any``, ``all``, ``sum``, ``min`` or ``max`` of a generator into a function.

        Return the function's name, and the names of the variables to call it with.
        """
        inner, captured = self._enter_scope(caller, generator)
        place = inner.place(generator)
        starts = {any: [], all: [], sum: ["total = 0"], min: ["known = False", "best = 0"]}
        for start in starts.get(callee, starts[min]):
            inner.emit(start, generator)
        for clause in generator.generators:
            inner.loop(clause.target, clause.iter, generator)
            inner._depth += 1
            inner._bind_targets(generator)
            for test in clause.ifs:
                inner.emit(f"if {inner.expression(test)}:", generator)
                inner._depth += 1
        inner.emit(f"element = {inner.expression(generator.elt)}", generator)
        if callee is any:
            inner.emit("if element: return True", generator)
        elif callee is all:
            inner.emit("if not element: return False", generator)
        elif callee is sum:
            inner.emit(f"total = rt.add(c, {place}, total, element)", generator)
        else:
            operator = "<" if callee is min else ">"
            inner.emit(f"if not known or element {operator} best:", generator)
            inner.emit("    best = element", generator)
            inner.emit("known = True", generator)
        inner._depth = 1
        if callee in (min, max):
            inner.emit(f"if not known: rt.fail(c, {place}, {UNPACK}, 0, 1)", generator)
        results = {any: "False", all: "True", sum: "total"}
        inner.emit(f"return {results.get(callee, 'best')}", generator)
        name = self._new_name("g")
        self._add_function(name, ["c", *captured], inner.lines)
        return name, captured

    def _enter_scope(self, caller: Statements, node: ast.AST) -> tuple[Statements, list[str]]:
        """Return a new translation for a nested scope, and the translated names of the variables that it captures."""
        inner = Statements(self, caller.function, caller.owner, caller.source, caller.symbols, caller.variables)
        inner.lengths = dict(caller.lengths)
        stored = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
        if isinstance(node, ast.Lambda):
            stored |= {argument.arg for argument in node.args.args}
        for name in stored:
            inner.symbols.pop(name, None)
        inner.variables |= stored
        names_read = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        captured = sorted((names_read & caller.variables) - stored - caller.symbols.keys())
        return inner, [f"v_{name}" for name in captured]

    def placement(self, caller: Statements, node: ast.AST, reject: ast.expr) -> tuple[str, list[str]]:
        """Translate a placement with ``reject`` into a function that places an item where this allows it.

        Return the function's name, and the names of the variables to call it with.
        """
        if not isinstance(reject, ast.Lambda):  # make a lambda that calls it
            names = ("column_", "row_")
            call = ast.Call(reject, [ast.Name(name, ast.Load()) for name in names], [])
            arguments = ast.arguments([], [ast.arg(name) for name in names], None, [], [], None, [])
            reject = ast.fix_missing_locations(ast.copy_location(ast.Lambda(arguments, call), node))
            for part in ast.walk(reject):
                if hasattr(part, "lineno"):
                    ast.copy_location(part, node)
        inner, captured = self._enter_scope(caller, reject)
        x, y = (f"v_{argument.arg}" for argument in reject.args.args)
        inner.emit("for _ in range(tries):", node)
        inner.emit(f"    {x}, {y} = rt.draw_once(c, place, top, size)", node)
        test = inner.expression(reject.body)
        inner.emit(f"    if not rt.is_taken(c, {self.bodies}, {x}, {y}) and not {test}:", node)
        inner.emit(f"        return rt.put(c, place, item, {x}, {y})", node)
        inner.emit(f"rt.fail(c, place, {NO_PLACE}, size[0], size[1])", node)
        inner.emit("return np.int64(0), np.int64(0), np.int64(0)", node)
        name = self._new_name("p")
        self._add_function(name, ["c", "place", "item", "top", "size", "tries", *captured], inner.lines)
        return name, captured

    def diagram(self, text: str, place: int) -> list[str]:
        """Return the translated statements that lay out a diagram; ``place`` is the number of the call's place."""
        writer = _DiagramWriter(self, place)
        from_text(text, writer)  # type: ignore[arg-type]  # it calls these methods alone
        return writer.lines

    def number_template(self, template: tuple[str | None, ...]) -> int:
        """Return the number of a mission's template, from 1: 0 is the world's first mission."""
        if template not in self._templates:
            self._templates.append(template)
        return self._templates.index(template) + 1

    def scratch(self, length: int, *, is_float: bool) -> str:
        """Reserve scratch memory for a list of ``length`` numbers; return the translated source of an array on it.

        Raises:
            TranslationError: if the world's lists need too much memory.
        """
        start = self._scratch
        self._scratch += length
        if self._scratch > SCRATCH_NUMBERS:
            raise TranslationError(
                f"lists of over {SCRATCH_NUMBERS} numbers cannot be translated; declare an IntArray field"
            )
        return f"rt.view_1(rt.{'float_scratch' if is_float else 'scratch'}(c), {start}, {length})"


class _DiagramWriter:
    """A stand-in for the grid on which `from_text` lays out a diagram, and which writes statements instead."""

    def __init__(self, translation: Translation, place: int) -> None:
        self.kinds = translation.world.kinds
        self.lines: list[str] = []
        self._translation = translation
        self._place = place

    def put(self, thing: Item, x: int, y: int) -> None:
        numbers = item_numbers(thing, self._translation.kind_number)
        self.lines.append(f"rt.put(c, {self._place}, {numbers!r}, {x}, {y})")

    def put_agent(self, x: int, y: int, direction: int) -> None:
        self.lines.append(f"rt.put_agent(c, {self._place}, {self._translation.bodies}, {x}, {y}, {direction}, 0)")
