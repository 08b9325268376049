"""The compiled rules of a world: whether there are any, and how one world uses them.

A batch compiles its rules when it is made, `minihuman check` and `compile_rules` when they are asked to. A world alone
uses what was compiled before and otherwise runs as plain Python, which gives the same numbers.
"""

import re
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.core.state import MAX_STEPS, STEP
from minihuman.worlds.grid.own import entries
from minihuman.worlds.grid.own.entries import FAULT
from minihuman.worlds.grid.own.faults import error_of
from minihuman.worlds.grid.own.fields import own_numbers
from minihuman.worlds.grid.own.library import RulesLibrary, can_load, compile_library, find_library
from minihuman.worlds.grid.own.passes import step_own
from minihuman.worlds.grid.own.source_names import TranslationError
from minihuman.worlds.grid.own.translation import Program, Translation

_KEPT: "WeakKeyDictionary[type, list[_Translated]]" = WeakKeyDictionary()
# methods of the base classes whose place compiled rules take; a class with its own is not translated
_PLAIN_METHODS = ("step", "advance", "reset", "observation", "look", "_lay_out", "save", "restore")
_OURS = "minihuman."


@dataclass(frozen=True, slots=True)
class _Translated:
    """The result of translating a class's rules, valid for worlds with certain attributes.

    Attributes:
        program: the translated rules; None if they cannot be translated.
        refusal: why they cannot be translated, or "".
        kinds: by name, the types of the attributes that the rules read as settings.
    """

    program: Program | None
    refusal: str
    kinds: dict[str, type]

    def fits(self, world: Any) -> bool:
        """Return whether a world's attributes are those with which the rules were translated."""
        if self.program is None:
            return True
        attributes = vars(world)
        has_constants = all(attributes.get(name) == constant for name, constant in self.program.fixed.items())
        return has_constants and all(type(attributes.get(name)) is kind for name, kind in self.kinds.items())


def translate_rules(world: Any) -> Program:
    """Return a world's rules as translated source.

    Raises:
        TranslationError: if they cannot be translated; the message names the line and what to write instead.
    """
    translations = _KEPT.setdefault(type(world), [])
    for translated in translations:
        if translated.fits(world):
            break
    else:
        translated = _try_translation(world)
        translations.append(translated)
    if translated.program is None:
        raise TranslationError(translated.refusal)
    return translated.program


def _try_translation(world: Any) -> _Translated:
    """Translate a world's rules; the result holds the program, or the reason why there is none."""
    try:
        _check_methods(world)
        program = Translation(world).translate()
    except TranslationError as refusal:
        return _Translated(None, str(refusal), {})
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        # source of an unforeseen form: the world still runs, as plain Python
        return _Translated(None, f"the rules of {type(world).__name__} cannot be translated ({error!r})", {})
    names = (*program.settings, *program.float_settings)
    return _Translated(program, "", {name: type(vars(world)[name]) for name in names})


def _check_methods(world: Any) -> None:
    """Check that compiled rules can take the place of all that a world's class defines.

    Raises:
        TranslationError: if the class has its own of `_PLAIN_METHODS`, or an instruction as its mission.
    """
    for owner in type(world).__mro__:
        if owner.__module__.startswith(_OURS) and not owner.__module__.startswith("minihuman.worlds.grid.layouts."):
            break
        for name in _PLAIN_METHODS:
            if name in vars(owner):
                raise TranslationError(
                    f"{owner.__name__} has its own {name}, which cannot be translated; write layout and "
                    "reward_and_done, and name the fields that agents see in `observed`"
                )
    if isinstance(getattr(world, "mission_space", None), InstructionSpace):
        raise TranslationError(f"{type(world).__name__} has an instruction as its mission, which cannot be translated")


def compile_rules(world: Any) -> None:
    """Compile a world's rules, unless the user's cache has them, so that worlds of the class run them from now on.

    Raises:
        TranslationError: if they cannot be translated or compiled; the message names the line and what to do.
    """
    program = translate_rules(world)
    vars(world).pop("_has_no_rules", None)
    try:
        compile_library(program.text, has_steps=program.has_reward)
    except TranslationError as refusal:
        match = re.match(r"LINE (\d+)\n(.*)", str(refusal), re.DOTALL)
        if match is None:
            raise
        line = int(match[1])
        if 0 < line <= len(program.lines):
            location = program.place(program.lines[line - 1])
        else:
            location = "the rules"
        raise TranslationError(f"{location}: {_explain_failure(match[2])}") from refusal


def _explain_failure(text: str) -> str:
    """Return an error text for an author, with the first lines of Numba's message ``text`` that state the error."""
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line).strip() for line in text.splitlines()]
    error_lines = [
        line for line in lines if line and not line.startswith(("Failed in", "During", "File", "<source", "[", "-"))
    ]
    reason = "; ".join(error_lines[:2]) or "Numba cannot compile this"
    return f"this cannot be compiled ({reason[:300]}); give each variable values of one kind"


def describe_rules(world: Any) -> str:
    """Compile a world's rules and return "compiled", or "not compiled, because ..."."""
    try:
        compile_rules(world)
    except TranslationError as refusal:
        return f"not compiled, because {refusal}"
    return "compiled"


def load_rules(world: Any) -> "WorldRules | None":
    """Return a world's rules if they were compiled before; None if they run as plain Python."""
    if "_has_no_rules" in vars(world) or type(world).__module__.startswith(_OURS):
        return None
    rules = _find_rules(world)
    if rules is None:
        vars(world)["_has_no_rules"] = True  # so that a reset does not look for them again
    return rules


def _find_rules(world: Any) -> "WorldRules | None":
    """Return a world's rules from memory or the user's cache; None if they were not compiled."""
    if not can_load():
        return None
    try:
        program = translate_rules(world)
    except TranslationError:
        return None
    library = find_library(program.text, has_steps=program.has_reward)
    if library is None:
        return None
    return WorldRules(world, program, library)


def raise_fault(program: Program, table: NDArray[np.int64], *, world: int | None = None) -> NoReturn:
    """Raise the error that compiled rules recorded in a table (see `entries`).

    If ``world`` is given, the message names this number of a world in a batch.

    Raises:
        Exception: what Python would have raised; the message begins with the author's file and line.
    """
    kind, place, first, second = table[FAULT : FAULT + 4].tolist()
    location = program.place(place)
    if world is not None:
        location = f"{location} (world {world})"
    raise error_of(kind, first, second, location)


def mission_of(program: Program, parts: NDArray[np.int64], first: str) -> str:
    """Return the mission that a layout has set, or the mission ``first`` if it set none.

    ``parts`` are the number of the template from 1, or 0, and for each placeholder whether a text fills it, and the
    number of that text or the number that fills it.
    """
    number = int(parts[0])
    if number == 0:
        return first
    fillings = iter(zip(parts[1::2].tolist(), parts[2::2].tolist(), strict=True))
    sentence = []
    for part in program.templates[number - 1]:
        if part is None:
            is_text, filling = next(fillings)
            sentence.append(program.texts[filling] if is_text else str(filling))
        else:
            sentence.append(part)
    return "".join(sentence)


def first_mission_of(world: Any) -> str:
    """Return the mission that a world has in episodes in which the layout sets none."""
    if hasattr(world, "mission_space"):
        return str(world.mission_space.first())
    return str(world.first_mission)


def setting_arrays(world: Any, program: Program) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the numbers that the rules read from a world's attributes: the whole numbers, and the floats."""
    whole = np.array([int(getattr(world, name)) for name in program.settings], np.int64)
    return whole, np.array([getattr(world, name) for name in program.float_settings], np.float64)


class WorldRules:
    """The compiled rules of one world, with their own memory. A copy of the world starts without compiled rules.

    Attributes:
        has_layout: whether the layout is compiled.
        has_reward: whether `reward_and_done` is compiled.
        draws: whether `reward_and_done` draws random numbers.
        step: takes an action and an array for the image, makes one step of a world with one body, and returns what
            `passes.step_own` does.
    """

    def __init__(self, world: Any, program: Program, library: RulesLibrary) -> None:
        self.has_layout = program.has_layout
        self.has_reward = program.has_reward
        self.draws = program.draws
        self._program = program
        self._library = library
        self._row = world._row
        self._own = own_numbers(world)
        self._missions = np.zeros(program.mission_length, np.int64)
        self._scratch = np.zeros(max(program.scratch, 1), np.int64)
        bodies = int(getattr(world, "bodies", 1))
        self._actions = np.zeros(bodies, np.int64)
        self._rewards = np.zeros(bodies)
        self._flags = np.array([0, 0, 1], np.uint8)  # terminated, truncated, stepped
        self._worlds = np.zeros(1, np.int64)
        self._settings, self._float_settings = setting_arrays(world, program)
        self._table = entries.make_table(
            {
                entries.ROWS: self._row[np.newaxis],
                entries.OWN_NUMBERS: self._own,
                entries.INT_SETTINGS: self._settings,
                entries.FLOAT_SETTINGS: self._float_settings,
                entries.RNG: world._rng_state,
                entries.MISSIONS: self._missions,
                entries.ACTIONS: self._actions,
                entries.REWARDS: self._rewards,
                entries.TERMINATED: self._flags[:1],
                entries.TRUNCATED: self._flags[1:2],
                entries.STEPPED: self._flags[2:],
                entries.WORLDS: self._worlds,
                entries.SCRATCH: self._scratch,
            }
        )
        self._table[entries.COUNT] = 1
        self._address = self._table.ctypes.data
        self.step = partial(step_own, library.step_address, self._address, self._row, world._rng_state)

    def __reduce__(self) -> tuple[Any, tuple[()]]:
        return type(None), ()

    def refresh_for(self, world: Any) -> bool:
        """Return whether these are the rules of the world as it is now; if so, read its settings again."""
        if self._row is not world._row or self._own is not own_numbers(world):
            return False
        try:
            if translate_rules(world) is not self._program:
                return False
        except TranslationError:
            return False
        if len(self._settings) or len(self._float_settings):
            self._settings[:], self._float_settings[:] = setting_arrays(world, self._program)
        return True

    def lay_out(self, world: Any) -> str:
        """Lay out an episode, drawing from the random stream in the world's memory, and return its mission.

        It is the world's first mission, unless the layout sets another.
        """
        if self._library.layout_of_one(self._address):
            raise_fault(self._program, self._table)
        return mission_of(self._program, self._missions, first_mission_of(world))

    def judge_team(
        self, actions: NDArray[np.int64], rewards: tuple[float, ...], terminated: bool
    ) -> tuple[tuple[float, ...], bool]:
        """Run a team's `reward_and_done` after a joint action; return the rewards and whether the episode ended.

        ``rewards`` and ``terminated`` are what the grid's own rules say.
        """
        self._actions[:] = actions
        self._rewards[:] = rewards
        row = self._row
        self._flags[0] = terminated
        self._flags[1] = row[STEP] >= row[MAX_STEPS]
        assert self._library.step_of_one is not None
        if self._library.step_of_one(self._address):
            raise_fault(self._program, self._table)
        return tuple(self._rewards.tolist()), bool(self._flags[0])

    def raise_fault(self) -> NoReturn:
        """Raise what the author's rules raised in the last step, which the step's status says."""
        raise_fault(self._program, self._table)
