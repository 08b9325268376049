"""How long a study's tables take, from logs to Parquet, and whether memory grows with the study.

    python -m benchmarks.tables [SESSIONS]
    python -m benchmarks.tables memory [SESSIONS ...]

The first exports a study of 200 sessions (or as many as asked): copies, each in its own folder, of four sessions of
the shipped study that simulated people really played. It prints the time on the clock, and the time all processors
spent together: where half of that is less than the clock says, something else kept them busy.

The second exports studies of 1,000 and 10,000 sessions of one short episode, and prints the highest memory.
"""

import multiprocessing
import resource
import sys
import tempfile
import time
from pathlib import Path

from minihuman.data.selection import Selection
from minihuman.export.run import export

PROTOCOL = Path(__file__).parents[1] / "protocols" / "fourrooms-transfer.toml"
DIFFERENT = 4
SIZES = (1_000, 10_000)


def make_study(study: Path, logs: list[Path], sessions: int) -> Path:
    """A study's folder with that many finished logs, taken in turn."""
    for index in range(sessions):
        where = study / f"sub-{index:05}" / "ses-01"
        where.mkdir(parents=True)
        (where / f"sub-{index:05}_ses-01.mcap").hardlink_to(logs[index % len(logs)])
    return study


def processors_s() -> float:
    """What this process and the ones it waited for have spent, seconds."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def speed(sessions: int) -> None:
    """Time the exports of one study, Parquet and CSV apart."""
    # here, as a process that reads starts with this module's imports, and needs no world: so it is on a command line
    from minihuman.lab.protocol_file import read_protocol
    from minihuman.seats.simulate import simulate

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        played = simulate(
            read_protocol(PROTOCOL), folder / "played", participants=DIFFERENT, seed=0, player="human-like"
        )
        study = make_study(folder / "study", list(played), sessions)
        for kind in ("parquet", "csv"):
            began, spent = time.perf_counter(), processors_s()
            written, _ = export(kind, study, folder / kind, Selection())
            took, spent = time.perf_counter() - began, processors_s() - spent
            print(
                f"{sessions} sessions, {written.steps} steps, to {kind}: {took:.2f} s ({spent:.2f} processor-seconds)"
            )


def memory(sessions: int) -> None:
    """Export one study and print the highest memory; in a process of its own, as memory is not given back."""
    from tests.builders import session, write_log

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = write_log(session(blocks=("grid",), episodes=1), folder / "played")
        study = make_study(folder / "study", [log], sessions)
        began = time.perf_counter()
        export("parquet", study, folder / "out", Selection())
        took = time.perf_counter() - began
    mine, reader = (
        resource.getrusage(who).ru_maxrss / 1024 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print(f"{sessions:6} sessions: {mine:.0f} MiB in the writer, {reader:.0f} MiB in a reader, {took:.1f} s")


def main(arguments: list[str]) -> None:
    """Run the one that was asked for."""
    if arguments[:1] != ["memory"]:
        speed(int(arguments[0]) if arguments else 200)
        return
    for sessions in [int(size) for size in arguments[1:]] or SIZES:
        process = multiprocessing.get_context("spawn").Process(target=memory, args=(sessions,))
        process.start()
        process.join()


if __name__ == "__main__":
    main(sys.argv[1:])
