"""A BabyAI instruction in the form of Minigrid's instruction objects: `instrs`, which Minigrid's bot reads.

If Minigrid's verifier is imported, each view is an instance of its class: ``isinstance(env.instrs, GoToInstr)``.
"""

import builtins
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from minihuman.worlds.grid.babyai.encoding import described_objects, instruction_of
from minihuman.worlds.grid.babyai.language import After, And, Before, Clause, Instruction, ObjectDescription, PutNext
from minihuman.worlds.grid.object_views import ObjectView, ObjectViews
from minihuman.worlds.upstream_names import WorldAttributeError

Place = tuple[int, int]  # column, row
_OF_MINIGRID = "minigrid.envs.babyai.core.verifier"
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
        return getattr(sys.modules.get(_OF_MINIGRID), self._class_name, builtins.type(self))

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
        self._noted = [thing.cur_pos for thing in things]
        self._places: list[Place] = [place for place in self._noted if place is not None]

    @property
    def obj_poss(self) -> list[Place]:
        """Return the positions of the objects, column by column, where they were last put down.

        An object that the agent carries stays listed at its last position.
        """
        now = [thing.cur_pos for thing in self.obj_set]
        if any(place is not None and place != noted for place, noted in zip(now, self._noted, strict=True)):
            self._noted = now
            self._places = sorted(place for place in now if place is not None)
        return self._places

    def find_matching_objs(self, env: Any, use_location: bool = True) -> tuple[list[ObjectView], list[Place]]:
        """Return the objects that matched the description when the episode began, and their positions."""
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
        views.instructions = _view(instruction_of(row), _Things(views, described_objects(row).copy()))
    view: InstructionView = views.instructions
    return view


class _Things:
    """The objects that match each description of an instruction, read clause after clause."""

    def __init__(self, views: ObjectViews, bits: Any) -> None:
        self._views = views
        self._bits = bits  # by identity - 1
        self._clauses = 0

    def clause(self, clause: Clause) -> tuple[list[ObjectView], list[ObjectView]]:
        """Return the objects of the next clause, and the objects next to which they are put."""
        number = 2 * self._clauses
        self._clauses += 1
        return self._meant(number), self._meant(number + 1)

    def _meant(self, number: int) -> list[ObjectView]:
        identities = np.flatnonzero(self._bits >> number & 1) + 1
        things = [self._views.of_identity(identity) for identity in identities.tolist()]
        return sorted((thing for thing in things if thing.cur_pos is not None), key=_column_by_column)


def _column_by_column(thing: ObjectView) -> Place:
    assert thing.cur_pos is not None
    return thing.cur_pos


def _view(instruction: Instruction, things: _Things) -> InstructionView:
    sentence = str(instruction)
    if isinstance(instruction, And | Before | After):
        attributes: dict[str, Any] = {
            "instr_a": _view(instruction.left, things),
            "instr_b": _view(instruction.right, things),
            "strict": getattr(instruction, "strict", False),
        }
        return InstructionView(f"{type(instruction).__name__}Instr", sentence, attributes)
    meant, fixed_things = things.clause(instruction)
    description = DescriptionView(instruction.thing, meant)
    if hasattr(instruction, "strict"):
        strict = {"strict": instruction.strict}
    else:
        strict = {}
    if isinstance(instruction, PutNext):
        fixed = DescriptionView(instruction.other, fixed_things)
        return InstructionView("PutNextInstr", sentence, {"desc_move": description, "desc_fixed": fixed, **strict})
    name = {"GoTo": "GoToInstr", "Open": "OpenInstr", "Pickup": "PickupInstr"}[type(instruction).__name__]
    return InstructionView(name, sentence, {"desc": description, **strict})
