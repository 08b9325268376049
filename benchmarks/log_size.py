"""Where a log's bytes a step go, and what other ways to write the same would make of them.

    python -m benchmarks.log_size [--episodes N] [--against CHECKOUT]

Simulates a session of FourRooms, 100 steps an episode at most, and prints bytes a step by kind of record and by topic,
then the chunks packed harder, and the floor: every message of a topic side by side, byte by byte, without heads.
With ``--against``, it times finishing and reading a log of 2,000 steps here and by another checkout's software in turn.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import zstandard
from mcap.opcode import Opcode

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.codec import RECORD_TOPICS
from minihuman.log.names import STEP
from minihuman.log.paths import MAGIC
from minihuman.log.salvage.records import RECORD_HEADER, ChunkMessages
from minihuman.log.salvage.scan import LogScanner
from minihuman.runtime.simulated_session import simulate

HERE = Path(__file__).parents[1]
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


def time_log() -> None:
    """Print the least CPU milliseconds to finish a log of 20 episodes of 100 steps, and to read it by three readers."""
    from mcap.reader import make_reader
    from rerun.chunk import McapReader

    from minihuman.log.read.session_reader import read_log
    from minihuman.log.record.finalization import recover_log
    from minihuman.log.record.mcap_recorder import McapRecorder
    from tests.log.samples import STARTED_NS, session_events, session_plan

    def least(work: Callable[[], object]) -> float:
        spent = []
        for _ in range(7):
            begin = time.process_time()
            work()
            spent.append(1e3 * (time.process_time() - begin))
        return min(spent)

    with tempfile.TemporaryDirectory() as name:
        folder, plan = Path(name), session_plan(episodes=20)
        recorder = McapRecorder(folder, plan, started_ns=STARTED_NS)
        for event in session_events(plan, steps=100)[:-1]:
            recorder.write([event])
        recorder.leave()
        part, log = recorder.segment_path.part, recorder.segment_path.log
        live = part.read_bytes()

        def finish() -> None:
            log.unlink(missing_ok=True)
            part.write_bytes(live)
            recover_log(part)

        print(f"{least(finish):8.1f}  ms to finish; {log.stat().st_size / 2000:.1f} bytes a step")
        print(f"{least(lambda: read_log(log)):8.1f}  ms to read, minihuman")
        print(f"{least(lambda: [*make_reader(log.open('rb')).iter_messages()]):8.1f}  ms to read, mcap")
        shown = least(lambda: [chunk.to_record_batch() for chunk in McapReader(str(log)).stream()])
        print(f"{shown:8.1f}  ms to read, rerun", flush=True)


def compare(against: Path) -> None:
    """Run ``time_log`` by both checkouts in turn."""
    for checkout in (against, HERE, against, HERE):
        print(checkout.name, flush=True)
        subprocess.run(
            [sys.executable, __file__, "--time"],
            env=os.environ | {"PYTHONPATH": str(checkout)},
            cwd=checkout,
            check=True,
        )


def main() -> None:
    """Print what the docstring says."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--against", type=Path, default=None)
    parser.add_argument("--time", action="store_true")
    asked = parser.parse_args()
    if asked.time:
        return time_log()
    if asked.against:
        return compare(asked.against)
    with tempfile.TemporaryDirectory() as folder:
        protocol = decode_protocol(PROTOCOL.format(episodes=asked.episodes).encode())
        [log] = simulate(protocol, Path(folder), participants=1, seed=3, player="random")
        whole = log.read_bytes()
        chunks = [record for record in LogScanner(log).records() if isinstance(record, ChunkMessages)]
    steps = sum(chunk.count(STEP) for chunk in chunks)
    print(f"Python {platform.python_version()}, zstandard {zstandard.__version__}; {steps} steps")
    print(f"{len(whole) / steps:8.1f}  bytes a step")
    for name, size in by_record(whole).most_common():
        print(f"{size / steps:8.1f}  {name}")
    messages = Counter(message.channel.topic for chunk in chunks for message in chunk)
    for topic, count in messages.most_common():
        data = b"".join(message.data for chunk in chunks for message in chunk if message.channel.topic == topic)
        packed = len(zstandard.compress(data, 3)) / steps
        print(f"{count / steps:8.3f}  {topic}, {len(data) / steps:.1f} bytes a step, {packed:.1f} packed alone")
    for level in (3, 9, 15, 19):
        packed = sum(len(zstandard.compress(chunk.data, level)) for chunk in chunks)
        print(f"{packed / steps:8.1f}  chunks at zstd level {level}")
    floor = sum(len(zstandard.compress(side_by_side(chunk), 19)) for chunk in chunks)
    print(f"{floor / steps:8.1f}  the truth without heads, side by side, at level 19")


if __name__ == "__main__":
    main()
