"""Missions: a sentence with choices. The choices are numbers in a world's state; the sentence is made from them."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import COLOURS, KINDS
from minihuman.worlds.grid.core.state import FAILED, MISSION, Row
from minihuman.worlds.sentences import Sentences, words_in


class MissionSpace(Sentences):
    """Every sentence a template gives: ``MissionSpace("go to the {} door", COLOUR_WORDS)``.

    Choices are words by number: a list, or a mapping where the numbers have gaps.

    A template without ``{}`` has one sentence. The space is seeded like any other, and two spaces with the same
    sentences built the same way are equal.
    """

    def __init__(
        self, template: str, *choices: Sequence[str] | Mapping[int, str], seed: int | np.random.Generator | None = None
    ) -> None:
        if template.count("{}") != len(choices):
            raise WorldError(
                f"mission {template!r} has {template.count('{}')} places to fill and {len(choices)} lists of choices"
            )
        self.template = template
        self.choices = tuple(dict(words) if isinstance(words, Mapping) else dict(enumerate(words)) for words in choices)
        pattern = re.escape(template).replace(re.escape("{}"), "{}")
        self._pattern = re.compile(
            pattern.format(*("(?:" + "|".join(map(re.escape, words.values())) + ")" for words in self.choices))
        )
        texts = (template.replace("{}", " "), *(word for words in self.choices for word in words.values()))
        longest = template.format(*(max(words.values(), key=len) for words in self.choices))
        wordiest = template.format(
            *(max(words.values(), key=lambda text: len(words_in(text))) for words in self.choices)
        )
        super().__init__(
            words_in(" ".join(texts)), max_length=len(longest), most_words=len(words_in(wordiest)), seed=seed
        )

    @property
    def varies(self) -> bool:
        """Whether there is more than one sentence."""
        return bool(self.choices)

    def of(self, row: Row) -> str:
        """The sentence of a state."""
        return self.sentence(row[MISSION:FAILED].tolist()) if self.choices else self.template

    def sentence(self, numbers: Sequence[int]) -> str:
        """The sentence with these choices; numbers beyond the template's places are not looked at."""
        if not self.choices:
            return self.template
        return self.template.format(*(words[number] for words, number in zip(self.choices, numbers, strict=False)))

    def sample(self, mask: Any = None, probability: Any = None) -> str:
        """A sentence with drawn choices. Masks and probabilities are not supported."""
        if mask is not None or probability is not None:
            raise WorldError("a mission space draws every sentence alike; it takes neither mask nor probability")
        return self.sentence([list(words)[self.np_random.integers(len(words))] for words in self.choices])

    def first(self) -> str:
        """The sentence with the first of all choices: the mission of a world not yet reset."""
        return self.sentence([next(iter(words)) for words in self.choices])

    def contains(self, x: Any) -> bool:
        """Whether the template can give exactly this sentence."""
        return isinstance(x, str) and self._pattern.fullmatch(x) is not None

    def __repr__(self) -> str:
        return "MissionSpace(" + ", ".join(map(repr, (self.template, *self.choices))) + ")"

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, MissionSpace) and self.template == other.template and self.choices == other.choices

    __hash__ = None  # type: ignore[assignment]  # spaces hold a random stream, so none of them is hashable


COLOUR_WORDS = dict(enumerate(COLOURS))  # choices by colour number


def kind_words(*kinds: int) -> dict[int, str]:
    """Choices among some kinds."""
    return {kind: KINDS[kind] for kind in kinds}
