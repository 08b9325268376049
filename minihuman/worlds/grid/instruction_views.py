"""A BabyAI instruction in the form of Minigrid's instruction objects: `instrs`, which Minigrid's bot reads.

If Minigrid's verifier is imported, each view is an instance of its class: ``isinstance(env.instrs, GoToInstr)``.
"""

import builtins
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from minihuman.worlds.grid.babyai.encoding import described_objects, instruction_of
from minihuman.worlds.grid.babyai.language import After, And, Before, Instruction, ObjectDescription, PutNext
from minihuman.worlds.grid.object_views import ObjectView, ObjectViews
from minihuman.worlds.upstream_names import WorldAttributeError

Place = tuple[int, int]  # column, row
_MINIGRID_MODULE = "minigrid.envs.babyai.core.verifier"
_INSTEAD = {
    "verify": "env.unwrapped.subgoals() says what is done",
    "verify_action": "env.unwrapped.subgoals() says what is done",
    "reset_verifier": "reset the environment",
    "update_objs_poss": "positions are up to date whenever they are read",
    "env": "use the environment itself",
}


class _View:
    """Base class of the views.

    A view is an instance of the verifier class of the same name if Minigrid's is imported.
    """

    _class_name = ""

    @property  # type: ignore[misc]  # isinstance reads it, nothing writes it
    def __class__(self) -> builtins.type:
        return getattr(sys.modules.get(_MINIGRID_MODULE), self._class_name, builtins.type(self))

    def __getattr__(self, name: str) -> Any:
        if name in _INSTEAD:
            advice = f"; {_INSTEAD[name]}"
        else:
            advice = ""
        raise WorldAttributeError(f"a view of an instruction has no attribute {name!r}{advice}")


class DescriptionView(_View):
    """A description of objects: ``type``, ``color``, ``loc``, the objects that match it, and their positions."""

    _class_name = "ObjDesc"

    def __init__(self, description: ObjectDescription, things: Sequence[ObjectView]) -> None:
        self.type = description.kind
        self.color = description.colour
        self.loc = description.place
        self.obj_set = list(things)
        self._sentence = str(description)
        self._last_positions = [thing.cur_pos for thing in things]
        self._places: list[Place] = [place for place in self._last_positions if place is not None]

    @property
    def obj_poss(self) -> list[Place]:
        """Return the positions of the objects, column by column, where they were last put down.

        An object that the agent carries stays listed at its last position.
        """
        positions = [thing.cur_pos for thing in self.obj_set]
        pairs = zip(positions, self._last_positions, strict=True)
        if any(place is not None and place != last_place for place, last_place in pairs):
            self._last_positions = positions
            self._places = sorted(place for place in positions if place is not None)
        return self._places

    def find_matching_objs(self, env: Any, use_location: bool = True) -> tuple[list[ObjectView], list[Place]]:
        """Return the objects that matched the description when the episode began, and their positions.

        The parameters are Minigrid's, and have no effect.
        """
        return self.obj_set, self.obj_poss

    def surface(self, env: Any) -> str:
        """Return the description as text."""
        return self._sentence

    def __repr__(self) -> str:
        return f"{self.color} {self.type} {self.loc}"


class InstructionView(_View):
    """A clause with ``desc`` (or ``desc_move`` and ``desc_fixed``), or two clauses, ``instr_a`` and ``instr_b``."""

    def __init__(self, class_name: str, sentence: str, attributes: dict[str, Any]) -> None:
        self._class_name = class_name
        self._sentence = sentence
        vars(self).update(attributes)

    def surface(self, env: Any) -> str:
        """Return the instruction as text."""
        return self._sentence


def view_instruction(views: ObjectViews) -> InstructionView:
    """Return the view of an episode's instruction, the same view on each call."""
    if views.instructions is None:
        row = views.state.row
        things = _DescribedObjects(views, described_objects(row).copy())
        views.instructions = _build_view(instruction_of(row), things)
    view: InstructionView = views.instructions
    return view


class _DescribedObjects:
    """The objects that match each description of an instruction, read clause after clause.

    Args:
        views: the views of the episode's objects.
        bits: for each object, by identity - 1, which descriptions it matches: bits 2 n and 2 n + 1 for clause n.
    """

    def __init__(self, views: ObjectViews, bits: Any) -> None:
        self._views = views
        self._bits = bits
        self._clause_count = 0  # of the clauses that were read

    def read_clause(self) -> tuple[list[ObjectView], list[ObjectView]]:
        """Return the objects of the next clause, and the objects next to which the clause wants them put."""
        number = 2 * self._clause_count
        self._clause_count += 1
        return self._matching(number), self._matching(number + 1)

    def _matching(self, number: int) -> list[ObjectView]:
        """Return the objects in the grid that match the description with a number, column by column."""
        identities = np.flatnonzero(self._bits >> number & 1) + 1
        things = [self._views.of_identity(identity) for identity in identities.tolist()]
        return sorted((thing for thing in things if thing.cur_pos is not None), key=_column_by_column)


def _column_by_column(thing: ObjectView) -> Place:
    assert thing.cur_pos is not None
    return thing.cur_pos


def _build_view(instruction: Instruction, things: _DescribedObjects) -> InstructionView:
    """Return the view of an instruction, reading the objects of its clauses from ``things`` in order."""
    sentence = str(instruction)
    if isinstance(instruction, And | Before | After):
        attributes: dict[str, Any] = {
            "instr_a": _build_view(instruction.left, things),
            "instr_b": _build_view(instruction.right, things),
            "strict": getattr(instruction, "strict", False),
        }
        return InstructionView(f"{type(instruction).__name__}Instr", sentence, attributes)
    clause_things, fixed_things = things.read_clause()
    description = DescriptionView(instruction.thing, clause_things)
    if hasattr(instruction, "strict"):
        strict = {"strict": instruction.strict}
    else:
        strict = {}
    if isinstance(instruction, PutNext):
        fixed = DescriptionView(instruction.other, fixed_things)
        return InstructionView("PutNextInstr", sentence, {"desc_move": description, "desc_fixed": fixed, **strict})
    name = {"GoTo": "GoToInstr", "Open": "OpenInstr", "Pickup": "PickupInstr"}[type(instruction).__name__]
    return InstructionView(name, sentence, {"desc": description, **strict})
