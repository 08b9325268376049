"""Missions: sentences with choices. The state holds the choices as numbers, from which the sentence is written.

The Gymnasium spaces of such sentences can be flattened, stacked, batched and shared. Gymnasium reads its own texts from
shared memory once, before the first reset; our sentences are read again at every copy.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import create_shared_memory, read_from_shared_memory, write_to_shared_memory
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.core.state import FAILED, MISSION, Row

NO_LETTER = 0  # in shared memory, where letters are their code points


def words_in(sentence: str) -> list[str]:
    """Return the words of a sentence in order. A comma counts as a word."""
    return sentence.replace(",", " ,").split()


class Sentences(spaces.Text):
    """A space of sentences made of given words, up to a maximum length. It is the base of all mission spaces.

    Args:
        words: all words that sentences can have, as `words_in` returns them, in any order.
        max_length: the number of letters in the longest sentence.
        most_words: the number of words in the sentence that has most of them.
        seed: the seed for drawing sentences.
    """

    def __init__(
        self, words: Iterable[str], *, max_length: int, most_words: int, seed: int | np.random.Generator | None = None
    ) -> None:
        self.most_words = most_words
        self.words: tuple[str, ...] = tuple(sorted(set(words)))
        letters = "".join(sorted({" ", *"".join(self.words)}))
        super().__init__(max_length, min_length=0, charset=letters, seed=seed)


class _SharedSentences(Sequence[str]):
    """The current sentences in shared memory. A copy is a tuple of the sentences at the time of copying."""

    def __init__(self, letters: NDArray[np.int32]) -> None:
        self._letters = letters  # (worlds, letters of the longest sentence)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        if isinstance(index, slice):
            return tuple(self)[index]
        row = self._letters[index]
        return "".join(map(chr, row[row != NO_LETTER].tolist()))

    def __len__(self) -> int:
        return len(self._letters)

    def __iter__(self) -> Iterator[str]:
        return (self[i] for i in range(len(self)))

    def __deepcopy__(self, memo: dict[int, Any]) -> tuple[str, ...]:
        return tuple(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]  # the sentences change

    def __repr__(self) -> str:
        return repr(tuple(self))


@create_shared_memory.register(Sentences)
def _create_shared(space: Sentences, n: int = 1, ctx: Any = None) -> Any:
    """Return shared memory, made by the multiprocessing context ``ctx``, for the sentences of ``n`` worlds.

    Each sentence has an int32 per letter.
    """
    return ctx.Array("i", n * max(space.max_length, 1))


@read_from_shared_memory.register(Sentences)
def _read_shared(space: Sentences, shared_memory: Any, n: int = 1) -> _SharedSentences:
    """Return the sentences of ``n`` worlds, which are read again from shared memory at each access."""
    return _SharedSentences(np.frombuffer(shared_memory.get_obj(), np.int32).reshape(n, -1))


@write_to_shared_memory.register(Sentences)
def _write_shared(space: Sentences, index: int, value: str, shared_memory: Any) -> None:
    """Write the sentence ``value`` of the world ``index`` into shared memory, filled up with `NO_LETTER`."""
    length = max(space.max_length, 1)
    row = np.frombuffer(shared_memory.get_obj(), np.int32)[index * length : (index + 1) * length]
    row[:] = NO_LETTER
    row[: len(value)] = [ord(letter) for letter in value]


class MissionSpace(Sentences):
    """All sentences that a template can form: ``MissionSpace("go to the {} door", COLOUR_WORDS)``.

    The choices are words by number: a list, or a mapping if the numbers have gaps. A template without ``{}`` has one
    sentence. The space is seeded like any other, and two spaces with the same template and choices are equal.
    """

    def __init__(
        self, template: str, *choices: Sequence[str] | Mapping[int, str], seed: int | np.random.Generator | None = None
    ) -> None:
        if template.count("{}") != len(choices):
            raise WorldError(
                f"mission {template!r} has {template.count('{}')} placeholders but {len(choices)} lists of choices; "
                "give one list for each placeholder"
            )
        self.template = template
        self.choices = tuple(dict(words) if isinstance(words, Mapping) else dict(enumerate(words)) for words in choices)
        alternatives = ["(?:" + "|".join(map(re.escape, words.values())) + ")" for words in self.choices]
        escaped_template = re.escape(template).replace(re.escape("{}"), "{}")
        self._pattern = re.compile(escaped_template.format(*alternatives))
        texts = [template.replace("{}", " ")]
        longest_choices = []
        wordiest_choices = []
        for words in self.choices:
            texts += words.values()
            longest_choices.append(max(words.values(), key=len))
            wordiest_choices.append(max(words.values(), key=lambda text: len(words_in(text))))
        max_length = len(template.format(*longest_choices))
        most_words = len(words_in(template.format(*wordiest_choices)))
        super().__init__(words_in(" ".join(texts)), max_length=max_length, most_words=most_words, seed=seed)

    @property
    def varies(self) -> bool:
        """Return whether there is more than one sentence."""
        return bool(self.choices)

    def of(self, row: Row) -> str:
        """Return the sentence that belongs to a state."""
        if self.choices:
            return self.sentence(row[MISSION:FAILED].tolist())
        return self.template

    def sentence(self, numbers: Sequence[int]) -> str:
        """Return the sentence with the given choices, one number per placeholder; further numbers are ignored."""
        if not self.choices:
            return self.template
        return self.template.format(*(words[number] for words, number in zip(self.choices, numbers, strict=False)))

    def sample(self, mask: Any = None, probability: Any = None) -> str:
        """Return a random sentence; raise a WorldError if a mask or a probability is given."""
        if mask is not None or probability is not None:
            raise WorldError("a mission space samples uniformly and takes no mask and no probability; remove them")
        return self.sentence([list(words)[self.np_random.integers(len(words))] for words in self.choices])

    def first(self) -> str:
        """Return the sentence with the first choice for each placeholder, the mission before the first reset."""
        return self.sentence([next(iter(words)) for words in self.choices])

    def contains(self, x: Any) -> bool:
        """Return whether the template can give exactly this sentence."""
        return isinstance(x, str) and self._pattern.fullmatch(x) is not None

    def __repr__(self) -> str:
        return "MissionSpace(" + ", ".join(map(repr, (self.template, *self.choices))) + ")"

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, MissionSpace) and self.template == other.template and self.choices == other.choices

    __hash__ = None  # type: ignore[assignment]  # spaces hold a random stream, so none of them is hashable


COLOUR_WORDS = dict(enumerate(COLOURS))  # choices by colour number


def kind_words(*kinds: int) -> dict[int, str]:
    """Return the names of some kinds by number, as choices of a `MissionSpace`."""
    return {kind: KINDS[kind] for kind in kinds}
