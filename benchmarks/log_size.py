"""Where a log's bytes a step go, and what other ways to write the same would make of them.

    python -m benchmarks.log_size [--episodes N]

Simulates a session of FourRooms, 100 steps an episode at most, and prints bytes a step by kind of record and by topic,
then the chunks packed harder, and the floor: every message of a topic side by side, byte by byte, without heads.
"""

import argparse
import platform
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import zstandard
from mcap.opcode import Opcode

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.codec import RECORD_TOPICS
from minihuman.log.names import STEP
from minihuman.log.paths import MAGIC
from minihuman.log.salvage.chunk import RECORD_HEADER, ChunkMessages
from minihuman.log.salvage.scan import LogScanner
from minihuman.runtime.simulated_session import simulate

PROTOCOL = """
[study]
name = "size"
version = "1"
seed = 11
participants = 1
[[groups]]
name = "all"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
actions = ["left", "right", "forward"]
max_steps = 100
episodes = {episodes}
"""


def by_record(log: bytes) -> Counter[str]:
    """The file's bytes by kind of record."""
    found, at = Counter[str](), len(MAGIC)
    while at < len(log) - len(MAGIC):
        opcode, length = RECORD_HEADER.unpack_from(log, at)
        found[Opcode(opcode).name.lower().replace("_", " ")] += RECORD_HEADER.size + length
        at += RECORD_HEADER.size + length
    return found


def side_by_side(chunk: ChunkMessages) -> bytes:
    """The payloads that hold the truth, those of one topic and length transposed: what columns would be packed from."""
    alike: dict[tuple[str, int], list[bytes]] = defaultdict(list)
    for message in chunk:
        if message.channel.topic in RECORD_TOPICS:
            alike[message.channel.topic, len(message.data)].append(message.data)
    tables = [np.frombuffer(b"".join(rows), np.uint8).reshape(len(rows), -1) for rows in alike.values()]
    return b"".join(table.T.tobytes() for table in tables)


def main() -> None:
    """Print what the docstring says."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=100)
    with tempfile.TemporaryDirectory() as folder:
        protocol = decode_protocol(PROTOCOL.format(episodes=parser.parse_args().episodes).encode())
        [log] = simulate(protocol, Path(folder), participants=1, seed=3, player="random")
        whole = log.read_bytes()
        chunks = [record for record in LogScanner(log).records() if isinstance(record, ChunkMessages)]
    steps = sum(chunk.count(STEP) for chunk in chunks)
    print(f"Python {platform.python_version()}, zstandard {zstandard.__version__}; {steps} steps")
    print(f"{len(whole) / steps:8.1f}  bytes a step")
    for name, size in by_record(whole).most_common():
        print(f"{size / steps:8.1f}  {name}")
    messages = Counter(message.channel.topic for chunk in chunks for message in chunk)
    print("messages a step:", ", ".join(f"{topic} {count / steps:.2f}" for topic, count in messages.most_common(5)))
    for level in (3, 9, 15, 19):
        packed = sum(len(zstandard.compress(chunk.data, level)) for chunk in chunks)
        print(f"{packed / steps:8.1f}  chunks at zstd level {level}")
    floor = sum(len(zstandard.compress(side_by_side(chunk), 19)) for chunk in chunks)
    print(f"{floor / steps:8.1f}  the truth without heads, side by side, at level 19")


if __name__ == "__main__":
    main()
