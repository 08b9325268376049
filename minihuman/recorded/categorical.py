"""Texts that recur, such as keys and verdicts: each kept once, and for every place which of them stands there."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray


class Words(Sequence[str]):
    """A sequence of texts, equal to any other of the same texts."""

    __slots__ = ("codes", "words")
    __hash__ = None  # type: ignore[assignment] # as a list

    def __init__(self, codes: NDArray[np.integer[Any]], words: Sequence[str]) -> None:
        self.codes = codes  # (n,) places in ``words``
        self.words = words  # each another

    @classmethod
    def of(cls, texts: Iterable[str]) -> "Words":
        """These texts."""
        if isinstance(texts, Words):
            return texts
        codes: dict[str, int] = {}
        return cls(np.array([codes.setdefault(text, len(codes)) for text in texts], np.int64), tuple(codes))

    @classmethod
    def joined(cls, parts: Sequence["Words"]) -> "Words":
        """Several, one behind the other; there is at least one."""
        words = parts[0].words
        if all(part.words == words for part in parts):
            return cls(np.concatenate([part.codes for part in parts]), words)
        all_words: dict[str, int] = {}
        codes = [
            np.array([all_words.setdefault(word, len(all_words)) for word in part.words], np.int64)[part.codes]
            for part in parts
        ]
        return cls(np.concatenate(codes), tuple(all_words))

    def __len__(self) -> int:
        return len(self.codes)

    def __iter__(self) -> Iterator[str]:
        return map(self.words.__getitem__, self.codes.tolist())

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> "Words": ...
    def __getitem__(self, place: int | slice) -> "str | Words":
        return Words(self.codes[place], self.words) if isinstance(place, slice) else self.words[self.codes[place]]

    def __eq__(self, other: object) -> bool:
        return list(self) == list(other) if isinstance(other, Sequence) else NotImplemented

    def __repr__(self) -> str:
        return f"Words.of({list(self)!r})"

    def are(self, wanted: Collection[str]) -> NDArray[np.bool_]:
        """Where one of some texts stands, (n,)."""
        are: NDArray[np.bool_] = np.array([word in wanted for word in self.words], np.bool_)[self.codes]
        return are

    def counted(self, where: NDArray[np.bool_] | slice = slice(None)) -> Counter[str]:
        """How often each text stands in the places that are chosen, 0 for one that does not."""
        counts = np.bincount(self.codes[where], minlength=len(self.words))
        return Counter(dict(zip(self.words, counts.tolist(), strict=True)))

    def first(self, where: NDArray[np.bool_]) -> dict[str, int]:
        """The first of the chosen places in which each text stands, for those that do in any."""
        places = np.flatnonzero(where)
        codes, firsts = np.unique(self.codes[places], return_index=True)
        return {self.words[code]: place for code, place in zip(codes.tolist(), places[firsts].tolist(), strict=True)}
