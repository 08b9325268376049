"""The Gymnasium space of instructions: all sentences of a grammar."""

from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai.encoding import sentence_of
from minihuman.worlds.grid.babyai.language import (
    NOUNS,
    PLACES,
    After,
    And,
    Before,
    Clause,
    GoTo,
    Instruction,
    ObjectDescription,
    Open,
    Part,
    Pickup,
    PutNext,
    clauses,
    parse,
)
from minihuman.worlds.grid.core.state import Row
from minihuman.worlds.grid.missions import Sentences, words_in

VERBS: dict[str, type[Clause]] = {"go to": GoTo, "open": Open, "pick up": Pickup, "put": PutNext}
LONGEST_CLAUSE = PutNext(ObjectDescription("ball", "purple", "front"), ObjectDescription("ball", "purple", "front"))
VOCABULARY = """, a after and ball behind blue box door front go green grey in key left next object of on open pick
purple put red right the then to up yellow you your"""  # of all levels


class InstructionSpace(Sentences):
    """All sentences with the given verbs: ``InstructionSpace("go to", "open", places=False, clauses=1)``.

    Args:
        verbs: any of "go to", "open", "pick up" and "put"; none for all of them.
        places: whether objects may be described by their place.
        clauses: the maximum number of clauses in a sentence, 1 to 4.
        seed: the seed for drawing sentences.

    Raises:
        WorldError: if a verb is unknown, or the number of clauses is out of range.
    """

    varies = True  # the sentence changes from episode to episode

    def __init__(
        self, *verbs: str, places: bool = True, clauses: int = 4, seed: int | np.random.Generator | None = None
    ) -> None:
        for verb in verbs:
            if verb not in VERBS:
                raise WorldError(f"unknown verb {verb!r}; use one of {', '.join(VERBS)}")
        if not 1 <= clauses <= 4:
            raise WorldError(f"an instruction cannot have {clauses!r} clauses; use 1 to 4")
        self.verbs = tuple(verb for verb in VERBS if verb in verbs or not verbs)
        self.places = places
        self.clauses = clauses
        longest = str(After(*(And(LONGEST_CLAUSE, LONGEST_CLAUSE),) * 2))
        super().__init__(VOCABULARY.split(), max_length=len(longest), most_words=len(words_in(longest)), seed=seed)

    def of(self, row: Row) -> str:
        """Return the instruction in a row of state as a sentence."""
        return sentence_of(row)

    def first(self) -> str:
        """Return the fixed sentence that is a world's mission before its first reset."""
        return str(
            self._build_clause(VERBS[self.verbs[0]], ObjectDescription("door" if self.verbs[0] == "open" else "ball"))
        )

    def contains(self, x: Any) -> bool:
        """Return whether a value is a sentence of the grammar."""
        if not isinstance(x, str):
            return False
        try:
            instruction = parse(x)
        except WorldError:
            return False
        return str(instruction) == x and self.admits(instruction)

    def admits(self, instruction: Instruction) -> bool:
        """Return whether an instruction has only the verbs, the places and the number of clauses of this space."""
        clause_list = clauses(instruction)
        things = [
            thing for clause in clause_list for thing in (clause.thing, getattr(clause, "other", ObjectDescription()))
        ]
        return (
            len(clause_list) <= self.clauses
            and all(type(clause) in {VERBS[verb] for verb in self.verbs} for clause in clause_list)
            and (self.places or all(thing.place is None for thing in things))
        )

    def sample(self, mask: Any = None, probability: Any = None) -> str:
        """Return a random sentence; raise a WorldError if a mask or a probability is given."""
        if mask is not None or probability is not None:
            raise WorldError("an instruction space takes no mask and no probability; remove them")
        count = int(self.np_random.integers(1, self.clauses + 1))
        clause_list = [self._draw_clause() for _ in range(count)]
        instruction: Instruction = clause_list[0]
        if count == 2 and self._draw_below(2):
            instruction = And(*clause_list)
        elif count > 1:
            # the draw for three clauses is made for every count, as part of the random stream
            split = {2: 1, 3: 1 + self._draw_below(2), 4: 2}[count]
            join = (Before, After)[self._draw_below(2)]
            instruction = join(self._join_clauses(clause_list[:split]), self._join_clauses(clause_list[split:]))
        return str(instruction)

    def _draw_clause(self) -> Clause:
        """Return a clause with a random verb and descriptions. Only doors are opened; they are never picked up."""
        verb = VERBS[self.verbs[self._draw_below(len(self.verbs))]]
        nouns: tuple[str, ...]
        if verb is Open:
            nouns = ("door",)
        elif verb is GoTo:
            nouns = NOUNS
        else:
            nouns = NOUNS[1:]  # without "door"
        # the second description is drawn for every verb, as part of the random stream
        return self._build_clause(verb, self._draw_description(nouns), self._draw_description(NOUNS))

    def _build_clause(
        self, verb: type[Clause], thing: ObjectDescription, other: ObjectDescription | None = None
    ) -> Clause:
        """Return a clause about a thing; ``other`` is used by PutNext alone, and is any box if it is None."""
        if verb is PutNext:
            return PutNext(thing, other or ObjectDescription("box"))
        return verb(thing)

    @staticmethod
    def _join_clauses(one_or_two: list[Clause]) -> Part:
        if len(one_or_two) == 1:
            return one_or_two[0]
        return And(*one_or_two)

    def _draw_description(self, nouns: tuple[str, ...]) -> ObjectDescription:
        colour = self._draw_below(len(COLOURS) + 1)
        place = self._draw_below(len(PLACES) + 1) if self.places else 0
        return ObjectDescription(
            nouns[self._draw_below(len(nouns))],
            COLOURS[colour - 1] if colour else None,
            PLACES[place - 1] if place else None,
            bool(self._draw_below(2)),
        )

    def _draw_below(self, count: int) -> int:
        """Draw a whole number from 0 to ``count`` - 1."""
        return int(self.np_random.integers(count))

    def __repr__(self) -> str:
        words = ", ".join(map(repr, self.verbs))
        return f"InstructionSpace({words}, places={self.places}, clauses={self.clauses})"

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, InstructionSpace) and repr(self) == repr(other)

    __hash__ = None  # type: ignore[assignment]  # spaces hold a random stream, so none of them is hashable
