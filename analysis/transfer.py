"""The transfer study: train source, baseline and transfers, and table what transferred weights are worth.

    python analysis/transfer.py run OUT [--protocol as-intended] [--runs 5] [--baselines 10] [--device auto]
    python analysis/transfer.py table [FOLDER ...] [--into OUT]

`run` trains (extra `learn`); an interrupted study resumes. `table` adds the finished jobs of any number of folders to
`analysis/transfer/`, one small file per job, and writes table, curves, speed and figure beside them.
"""

import argparse
import shutil
import sys
import time
from pathlib import Path

from minihuman.errors import LearnError, MinihumanError
from transfer_study.engines import open_engine, open_folder, read_merged, run_study
from transfer_study.job import RESULT
from transfer_study.plan import PROTOCOLS, TRANSFERS, TransferStudy, make_quick_study
from transfer_study.summary import RunInfo, get_published, write_report

SHIPPED = Path(__file__).parent / "transfer"


def run(given: argparse.Namespace, command: str) -> str:
    """Run every job that is not done yet; return the report."""
    if given.address is not None and given.engine != "ray":
        raise LearnError(f"--address is {given.address!r}, a Ray cluster's; add --engine ray")
    study = TransferStudy(
        protocol=given.protocol,
        runs=given.runs,
        baselines=given.baselines,
        steps=given.steps,
        source_steps=given.source_steps,
        seed=given.seed,
        transfers=TRANSFERS if given.only is None else tuple(given.only.upper().split(",")),
    )
    study = make_quick_study(study) if given.quick else study
    published = get_published(study, given.beside)
    started = time.monotonic()
    results = run_study(
        study,
        given.out,
        lambda: open_engine(given.engine, workers=given.workers, address=given.address),
        first_run=given.first_run,
        device=given.device,
    )
    info = RunInfo(command=command, engine=given.engine, wall_s=time.monotonic() - started)
    return write_report(study, results, given.out, info, beside=published)


def table(given: argparse.Namespace, command: str) -> str:
    """Copy results that the folder lacks into it; return the report."""
    folders = [*([given.into] if given.into.exists() else []), *given.folders]
    if not folders:
        raise LearnError(f"{given.into} holds no study; name the folder of a run")
    study, results = read_merged(folders)
    published = get_published(study, given.beside)
    open_folder(study, given.into)
    for job in results:
        found = next(folder for folder in folders if (folder / job.name / RESULT).exists())
        if found != given.into:
            (given.into / job.name).mkdir(parents=True, exist_ok=True)
            shutil.copyfile(found / job.name / RESULT, given.into / job.name / RESULT)
    return write_report(study, results, given.into, RunInfo(command=command, engine="", wall_s=0.0), beside=published)


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    running = commands.add_parser("run", help="train what is not trained yet")
    running.set_defaults(command=run)
    running.add_argument("out", type=Path, help="the folder of the results; an unfinished study there resumes")
    running.add_argument("--protocol", choices=PROTOCOLS, default="as-intended")
    running.add_argument("--runs", type=int, default=5, help="independent runs of the source and of every transfer")
    running.add_argument("--baselines", type=int, default=10, help="runs of the baseline")
    running.add_argument("--first-run", type=int, default=0, help="the first run to do here; others run elsewhere")
    running.add_argument("--steps", type=int, default=200_000, help="steps of the baseline and of each transfer")
    running.add_argument("--source-steps", type=int, help="steps of the source; by default the protocol's own")
    running.add_argument("--seed", type=int, default=1, help="the study's seed; every job derives its own")
    running.add_argument("--only", help="run only these transfers, as in M,ACM")
    running.add_argument("--quick", action="store_true", help="run far fewer steps; every output says so")
    running.add_argument("--workers", type=int, help="processes; by default one per core")
    running.add_argument("--engine", choices=("local", "ray"), default="local", help="a local pool, or Ray")
    running.add_argument("--address", help="the Ray cluster's address; without it a local one")
    running.add_argument("--device", default="auto", help="auto uses a GPU if there is one; cpu is reproducible")
    tabling = commands.add_parser("table", help="table the runs of one study, at any time, from several machines")
    tabling.set_defaults(command=table)
    tabling.add_argument("folders", type=Path, nargs="*", help="folders with runs of the study")
    tabling.add_argument("--into", type=Path, default=SHIPPED, help="the folder of job files, table and figure")
    for each in (running, tabling):
        each.add_argument("--beside", type=Path, help="a CSV of improvements to compare with, not the paper's")
    return parser.parse_args(arguments)


if __name__ == "__main__":  # processes of the local pool import this module
    given = parse(sys.argv[1:])
    try:
        print(given.command(given, " ".join(["python analysis/transfer.py", *sys.argv[1:]])))
    except MinihumanError as error:
        sys.exit(f"transfer.py: {error}")
