"""A chunk of a live file: messages packed as MCAP has them, where the library would make ten calls of each."""

import struct
import zlib

from mcap.opcode import Opcode

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, bytes that follow, channel, sequence, log time, publish time
_OF_A_MESSAGE = 22  # of those bytes, before its data
_CHUNK = struct.Struct("<BQQQQIIQ")  # opcode, bytes that follow, first time, last, bytes, CRC, no compression, bytes
_OF_A_CHUNK = 40


class LiveChunk:
    """Takes messages, and gives the chunk of those it took."""

    def __init__(self) -> None:
        self._records: list[bytes] = []
        self._times_ns: list[int] = []

    def add(self, channel: int, sequence: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take a message."""
        head = _MESSAGE.pack(Opcode.MESSAGE, _OF_A_MESSAGE + len(data), channel, sequence, log_ns, publish_ns)
        self._records += (head, data)
        self._times_ns.append(log_ns)

    def take(self) -> bytes:
        """The chunk; nothing if no message came."""
        if not self._records:
            return b""
        records, times_ns = b"".join(self._records), self._times_ns
        self._records, self._times_ns = [], []
        size, crc = len(records), zlib.crc32(records)
        return _CHUNK.pack(Opcode.CHUNK, _OF_A_CHUNK + size, min(times_ns), max(times_ns), size, crc, 0, size) + records
