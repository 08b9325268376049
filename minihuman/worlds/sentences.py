"""Spaces of sentences: what missions are told in, so that Gymnasium can flatten, stack, batch and share them.

Gymnasium reads its own texts from shared memory once, before the first reset; ours are read anew at every copy.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import create_shared_memory, read_from_shared_memory, write_to_shared_memory
from numpy.typing import NDArray

NO_LETTER = 0  # in shared memory, where letters are their code points


def words_in(sentence: str) -> list[str]:
    """A sentence's words in order; a comma is a word."""
    return sentence.replace(",", " ,").split()


class Sentences(spaces.Text):
    """A space of sentences made of some words, each at most so many letters long. Base of all mission spaces.

    Args:
        words: Every word that a sentence can have, as `words_in` gives them, in any order.
        max_length: Letters of the longest sentence.
        most_words: Words of the sentence that has most of them.
        seed: For drawing sentences.
    """

    def __init__(
        self, words: Iterable[str], *, max_length: int, most_words: int, seed: int | np.random.Generator | None = None
    ) -> None:
        self.most_words = most_words
        self.words: tuple[str, ...] = tuple(sorted(set(words)))
        letters = "".join(sorted({" ", *"".join(self.words)}))
        super().__init__(max_length, min_length=0, charset=letters, seed=seed)


class _Shared(Sequence[str]):
    """The sentences in shared memory as they are now. A copy is a tuple: what they were when it was made."""

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

    __hash__ = None  # type: ignore[assignment]  # it changes

    def __repr__(self) -> str:
        return repr(tuple(self))


@create_shared_memory.register(Sentences)
def _create(space: Sentences, n: int = 1, ctx: Any = None) -> Any:
    return ctx.Array("i", n * max(space.max_length, 1))


@read_from_shared_memory.register(Sentences)
def _read(space: Sentences, shared_memory: Any, n: int = 1) -> _Shared:
    return _Shared(np.frombuffer(shared_memory.get_obj(), np.int32).reshape(n, -1))


@write_to_shared_memory.register(Sentences)
def _write(space: Sentences, index: int, value: str, shared_memory: Any) -> None:
    length = max(space.max_length, 1)
    row = np.frombuffer(shared_memory.get_obj(), np.int32)[index * length : (index + 1) * length]
    row[:] = NO_LETTER
    row[: len(value)] = [ord(letter) for letter in value]
