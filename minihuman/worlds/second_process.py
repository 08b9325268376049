"""Plays a rehearsal of a world in a second process.

``python -m minihuman.worlds.second_process FILE`` reads a rehearsal as MessagePack from standard input, plays it, and
writes the resulting moments to FILE. A rehearsal must name only worlds that the user trusts.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from minihuman.errors import WorldError
from minihuman.worlds.adapters.world import World
from minihuman.worlds.conformance import Moment, Rehearsal, play
from minihuman.worlds.hashing import resolve_files

TIMEOUT_S = 300.0
_CANNOT_MAKE_STATUS = 2  # the exit status if the world cannot be made in the second process


def play_in_second_process(rehearsal: Rehearsal) -> Sequence[Moment] | str:
    """Play a rehearsal with pictures in another process; return its moments, or the reason why there are none."""
    resolved = replace(rehearsal, options=resolve_files(rehearsal.options))
    with TemporaryDirectory() as folder:
        out = Path(folder, "moments.msgpack")
        try:
            completed = subprocess.run(
                # -P: do not import what lies in the current folder, unless the path has it
                [sys.executable, "-P", "-m", __name__, str(out)],
                input=msgspec.msgpack.encode(resolved),
                capture_output=True,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONHASHSEED": "random"},
                timeout=TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"it took more than {TIMEOUT_S:g} s there"
        if not out.is_file():
            lines = completed.stderr.decode(errors="replace").strip().splitlines()
            if completed.returncode == _CANNOT_MAKE_STATUS and lines:
                return lines[-1]
            return f"the process ended with status {completed.returncode}"
        return msgspec.msgpack.decode(out.read_bytes(), type=list[Moment])


def main(out: Path) -> int:
    """Play the rehearsal on standard input, and write its moments to a file.

    Returns:
        The exit status: 0, or 2 if the world cannot be made in this process.
    """
    rehearsal = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Rehearsal)
    try:
        with closing(World(rehearsal.world, rehearsal.options, trusted=True)) as world:
            try:
                moments = play(world, rehearsal, draws=True)
            except WorldError:
                moments = []  # it could be played in the first process, and differs here
            out.write_bytes(msgspec.msgpack.encode(moments))
    except WorldError as error:
        print(error, file=sys.stderr)
        return _CANNOT_MAKE_STATUS
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
