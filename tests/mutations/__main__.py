"""Commands of mutation testing: draw, record, run."""

import argparse
import signal
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.mutations import drawing, table, trial
from tests.mutations.execution import KINDS, Record, read_commit, record_all, stop
from tests.mutations.mutant import PACKAGE, ROOT, Mutant, MutationError
from tests.mutations.planted import PLANTED


def main(words: Sequence[str] | None = None) -> int:
    """Run a command; return the exit status."""
    arguments = _make_parser().parse_args(words)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        return arguments.command(arguments)
    except MutationError as error:
        print(error, file=sys.stderr)
        return 2


def draw(arguments: argparse.Namespace) -> int:
    """Write drawn.json: replace mutants that are left out, whose place is gone, or that no recorded test executes."""
    mutants, left_out = drawing.read_drawn()
    sources = drawing.read_sources()
    mutants = mutants or drawing.draw(sources)
    if arguments.leave_out is not None:
        mutant = mutants[arguments.leave_out - len(PLANTED)]
        left_out.append(drawing.LeftOut(mutant, arguments.reason))
    record = Record.open(arguments.record) if arguments.record else None
    while True:
        mutants = drawing.replace_mutants(mutants, sources, [omission.mutant for omission in left_out])
        idle = [mutant for mutant in mutants if record and not _is_executed(record, mutant)]
        if not idle:
            break
        left_out += [drawing.LeftOut(mutant, "no test executes it") for mutant in idle]
    drawing.write_drawn(mutants, left_out, read_commit(ROOT))
    for number, mutant in enumerate(mutants, len(PLANTED)):
        source = sources[mutant.file]
        before, after = mutant.change(source)
        print(f"{number} {mutant.file}:{mutant.line(source)} {mutant.meaning}\n   - {before}\n   + {after}")
    return 0


def record(arguments: argparse.Namespace) -> int:
    """Run folders of tests under coverage that were not yet; go on where an earlier command stopped."""
    opened = Record.open(arguments.folder, arguments.project)
    kind = "nightly" if arguments.nightly else "default"
    files = opened.test_files(arguments.paths)
    mutants = [*PLANTED, *drawing.read_drawn()[0]] if arguments.mutants_only else []
    modules = sorted({mutant.file for mutant in mutants})
    for line in record_all(opened, kind, files, workers=arguments.workers, most_s=arguments.most_s, modules=modules):
        print(line, flush=True)
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Try mutants, write the table after each, and say what is wrong."""
    opened = Record.open(arguments.folder)
    mutants = [*PLANTED, *drawing.read_drawn()[0]]
    numbers = arguments.numbers or range(len(mutants))
    rows = {row.number: row for row in table.read_table()}
    with ThreadPoolExecutor(arguments.workers) as pool:
        for row in pool.map(lambda number: _try(number, mutants[number], opened, arguments.against), numbers):
            rows[row.number] = row
            table.write_table(rows.values())
            print(
                f"{row.number:2} {row.killed_by:9} {row.seconds:6.1f} s {row.place} {row.meaning}: {row.test}",
                flush=True,
            )
    errors = table.judge(list(rows.values()))
    print(*errors, sep="\n")
    return int(bool(errors))


def _try(number: int, mutant: Mutant, opened: Record, against: Path | None) -> table.Row:
    default = trial.ask_record(opened, "default", mutant)
    silent = not default.killed
    nightly = trial.ask_record(opened, "nightly", mutant) if silent else None
    earlier = trial.ask_earlier(against, mutant, opened) if silent and against else None
    source = (opened.project / PACKAGE / mutant.file).read_text(encoding="utf-8")
    return table.make_row(number, mutant, source, opened.commit, default, nightly, earlier)


def _is_executed(opened: Record, mutant: Mutant) -> bool:
    return any(opened.executing(kind, mutant) for kind in KINDS)


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.mutations", description=__doc__)
    commands = parser.add_subparsers(required=True)

    command = commands.add_parser("draw", help=draw.__doc__)
    command.set_defaults(command=draw)
    command.add_argument("--record", type=Path, help="the folder of a record")
    command.add_argument("--leave-out", type=int, metavar="NUMBER", help="of a drawn mutant that is to be replaced")
    command.add_argument("--reason", default="", help="why it is left out")

    command = commands.add_parser("record", help=record.__doc__)
    command.set_defaults(command=record)
    command.add_argument("folder", type=Path, help="of the record, outside the repository")
    command.add_argument("paths", nargs="*", help="test files or their folders; all without any")
    command.add_argument("--nightly", action="store_true", help="the nightly tests instead of the default ones")
    command.add_argument(
        "--mutants-only", action="store_true", help="measure only modules with mutants: enough for `run`, and quicker"
    )
    command.add_argument("--project", type=Path, default=ROOT, help="a checkout to begin the record of")
    command.add_argument("--most-s", type=float, default=1800.0, help="seconds that a folder may take")
    command.add_argument("-n", "--workers", type=int, default=1, help="folders at a time")

    command = commands.add_parser("run", help=run.__doc__)
    command.set_defaults(command=run)
    command.add_argument("folder", type=Path, help="of the record")
    command.add_argument("numbers", type=int, nargs="*", help="of mutants; all without any")
    command.add_argument("--against", type=Path, help="an earlier checkout, or its record, to ask about survivors")
    command.add_argument("-n", "--workers", type=int, default=1, help="mutants at a time")
    return parser


if __name__ == "__main__":
    sys.exit(main())
