"""A segment's samples of devices, kept as the log holds them until one is looked at: there may be very many."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import overload

from minihuman.log import topics
from minihuman.log.decode import decode
from minihuman.study.events import Sampled


class Samples(Sequence[Sampled]):
    """Samples in the order they were recorded, in session time.

    Raises:
        google.protobuf.message.DecodeError: when one is looked at that is none.
    """

    def __init__(self, messages: Sequence[bytes], start_ns: int) -> None:
        """``start_ns`` is the session time at which their segment began."""
        self._messages = messages
        self._start_ns = start_ns

    def __len__(self) -> int:
        return len(self._messages)

    def __iter__(self) -> Iterator[Sampled]:
        return map(self._read, self._messages)

    @overload
    def __getitem__(self, place: int) -> Sampled: ...
    @overload
    def __getitem__(self, place: slice) -> "Samples": ...
    def __getitem__(self, place: int | slice) -> "Sampled | Samples":
        if isinstance(place, slice):
            return Samples(self._messages[place], self._start_ns)
        return self._read(self._messages[place])

    def _read(self, message: bytes) -> Sampled:
        sampled = decode(topics.SAMPLE, message)
        assert isinstance(sampled, Sampled)
        return replace(sampled, t_ns=sampled.t_ns + self._start_ns)
