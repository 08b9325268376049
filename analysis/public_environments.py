"""Try public environments: check, simulate, verify and export every id of ``public_environments.toml``.

``python analysis/public_environments.py [--only PACKAGE ...] [--ids PATTERN ...] [--full]`` tries the ids of the
packages that are installed, each in a process of its own, and writes ``public_environments.csv``, a row per id, and
``public_environments.json`` with the versions; rows of what is not tried now stay. A study has one block of two short
episodes, played at random, with the rule of success that ``success`` states, or else what `minihuman check` finds.
Set ``MUJOCO_GL=egl``, ``SDL_VIDEODRIVER=dummy`` and ``SDL_AUDIODRIVER=dummy`` where there is no display.
"""

import argparse
import csv
import json
import multiprocessing
import os
import platform
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.selection import Selection
from minihuman.errors import ExportError, MinihumanError, WorldError
from minihuman.experiment.keys import DIGITS
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.stated_outcomes import find_outcome_rule
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.exporters.exporter import export_study, list_exporters
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.testing.checks import build_study
from minihuman.trust import TRUST_VARIABLE
from minihuman.worlds.adapters.world import World

FOLDER = Path(__file__).parent
TABLE = "public_environments.toml"
N_EPISODES = 2
MAX_STEPS = 8
TIMEOUT_S = 600.0
OF_TEAMS = ("overcooked", "pettingzoo")  # what these exporters hold a study of single players never has


@dataclass(frozen=True, slots=True)
class Family:
    """Ids of one package whose ends mean the same, by its documentation.

    Attributes:
        success: what a block states; "" where `minihuman check` finds the rule by itself.
    """

    package: str
    module: str
    ids: tuple[str, ...]  # patterns, as of file names
    success: str
    reason: str
    source: str

    @property
    def prefix(self) -> str:
        """What stands before an id, so that Gymnasium imports the package."""
        return "" if self.module in ("gymnasium", "minihuman") else f"{self.module}:"


@dataclass(slots=True)
class Trial:
    """What became of one id; each text is "" where there is nothing to say."""

    package: str
    version: str
    id: str
    check: str = "short"  # or "full", as before a study begins: 300 steps, twice, and in a second process
    rule: str = ""  # of success, as a plan has it
    stated_by: str = ""
    verdict: str = "played"
    refused_because: str = ""
    outcomes: str = ""
    exports: int = 0  # formats that hold it
    exports_refused: str = ""
    notices: str = ""
    failures: list[str] = field(default_factory=list)  # what should never be: faults of ours


def read_families(path: Path = FOLDER / TABLE) -> list[Family]:
    """Read the table of packages, families and rules."""
    packages = tomllib.loads(path.read_text(encoding="utf-8"))["packages"]
    return [
        Family(
            package["name"],
            package["module"],
            tuple(family["ids"]),
            family.get("success", ""),
            family["reason"],
            family["source"],
        )
        for package in packages
        for family in package["families"]
    ]


def list_ids(family: Family) -> list[str]:
    """List the ids that an installed package registers and that a family's patterns name."""
    package = family.module.partition(".")[0]
    if find_spec(package) is None:
        return []
    import_module(family.module)
    return [name for name in gymnasium.registry if any(fnmatchcase(name, pattern) for pattern in family.ids)]


def build_public_study(world_id: str, success: str) -> Protocol:
    """Build a study of two episodes, whose keys do the first of the environment's actions."""
    try:
        with closing(World(world_id)) as world:
            names = tuple(dict.fromkeys(world.action_names))[: len(DIGITS)]
            actions = names if world.actions.is_discrete else names[:-1]
            limit = world.step_limit
    except MinihumanError:
        actions = ("0",)
        limit = None
    block = {"name": "play", "world": world_id, "episodes": N_EPISODES, "actions": actions}
    block["max_steps"] = MAX_STEPS if limit is None else min(MAX_STEPS, limit)
    if success:
        block["success"] = success
    return build_study(
        {
            "study": {"name": "public", "version": "1", "seed": 5, "participants": 2},
            "keys": {"pool": DIGITS[: max(3, len(actions))]},
            "groups": [{"name": "everyone", "blocks": ["play"]}],
            "blocks": [block],
        }
    )


def try_environment(family: Family, name: str, folder: Path, *, is_full: bool) -> Trial:
    """Check, simulate, verify and export one id."""
    trial = Trial(family.package, version(family.package), name)
    protocol = build_public_study(family.prefix + name, family.success)
    stated = find_outcome_rule(protocol.blocks[0])
    trial.rule = stated.rule or "terminated and reward > 0"
    trial.stated_by = stated.stated_by
    trial.check = "full" if is_full else "short"
    try:
        notices = check_worlds(protocol, "study", provable=is_full)
    except MinihumanError as error:
        trial.verdict = "refused"
        trial.refused_because = str(error).rsplit(family.prefix + name, 1)[-1].lstrip("': ")
        return trial
    trial.notices = "; ".join(notice.removeprefix(f"{family.prefix}{name}: ") for notice in notices)
    try:
        (log,) = simulate(protocol, folder, participants=1, seed=1, player="random")
    except WorldError as error:
        trial.failures.append(f"it was not refused, and fails in a session: {error}")
        return trial
    trial.failures += [line for line, is_right in verify_session(log) if not is_right]
    trial.outcomes = " ".join(str(episode.outcome) for episode in read_log(log).episodes)
    _export(trial, folder)
    return trial


def _export(trial: Trial, folder: Path) -> None:
    refusals = {}
    for name in list_exporters():
        if name in OF_TEAMS:
            continue
        try:
            export_study(name, folder / "public", folder / f"as-{name}", Selection())
            trial.exports += 1
        except ExportError as error:
            refusals[name] = str(error).replace(f"{folder}/", "")
    trial.exports_refused = "; ".join(f"{name}: {reason}" for name, reason in refusals.items())


def _send_trial(family: Family, name: str, into: Connection, *, is_full: bool) -> None:
    with TemporaryDirectory() as folder:
        try:
            into.send(try_environment(family, name, Path(folder), is_full=is_full))
        except Exception as error:  # what the table is to show
            failure = f"{type(error).__name__}: {error}"
            into.send(Trial(family.package, version(family.package), name, verdict="failed", failures=[failure]))


def try_in_process(family: Family, name: str, *, is_full: bool, timeout_s: float) -> Trial:
    """Try one id in a process of its own, which an environment may end or hang."""
    ours, theirs = multiprocessing.get_context("fork").Pipe(duplex=False)
    send = partial(_send_trial, family, name, theirs, is_full=is_full)
    process = multiprocessing.get_context("fork").Process(target=send)
    process.start()
    theirs.close()
    try:
        if ours.poll(timeout_s):
            trial: Trial = ours.recv()
            return trial
        reason = f"nothing came within {timeout_s:g} s"
    except EOFError:
        process.join()
        reason = f"its process ended with status {process.exitcode}"
    finally:
        process.kill()
        process.join()
    return Trial(family.package, version(family.package), name, verdict="failed", failures=[reason])


def warm_up() -> None:
    """Export a foreign world here: what exporters import, and packages' names, are read once, not in each process."""
    with TemporaryDirectory() as folder:
        farama = Family("minigrid", "minigrid", ("*",), "", "", "")
        try_environment(farama, "MiniGrid-Empty-5x5-v0", Path(folder), is_full=False)


def try_all(families: Iterable[Family], patterns: Iterable[str], *, is_full: bool, timeout_s: float) -> Iterator[Trial]:
    """Try every id of the families that the patterns name."""
    for family in families:
        for name in list_ids(family):
            if any(fnmatchcase(name, pattern) for pattern in patterns):
                trial = try_in_process(family, name, is_full=is_full, timeout_s=timeout_s)
                print(
                    f"{trial.verdict:8} {name}: {trial.failures or trial.refused_because or trial.outcomes}", flush=True
                )
                yield trial


def read_trials(path: Path) -> dict[tuple[str, str], dict[str, str]]:
    """Read an earlier table's rows, by package and id."""
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {(row["package"], row["id"]): row for row in csv.DictReader(file)}


def write_trial(trial: Trial, folder: Path) -> None:
    """Write a trial into the table, and the versions: what was tried is kept if the run is interrupted."""
    path = folder / "public_environments.csv"
    rows: dict[tuple[str, str], Mapping[str, object]] = dict(read_trials(path))
    rows[trial.package, trial.id] = asdict(trial) | {"failures": "; ".join(trial.failures)}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(Trial.__dataclass_fields__), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[key] for key in sorted(rows))
    installed = {name: _find_version(name) for name in ("minihuman-lab", "numpy")}
    tried = {package: str(rows[package, name]["version"]) for package, name in sorted(rows)}
    record = {
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        "episodes": N_EPISODES,
        "steps": MAX_STEPS,
        "versions": installed | tried,
    }
    (folder / "public_environments.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def write_page(folder: Path, page: Path) -> None:
    """Write the page of the docs: the rules, and what became of each id."""
    with (folder / "public_environments.csv").open(encoding="utf-8", newline="") as file:
        trials = list(csv.DictReader(file))
    record = json.loads((folder / "public_environments.json").read_text(encoding="utf-8"))
    tried = {trial["package"] for trial in trials}
    rules = [_describe_family(family) for family in read_families() if family.package in tried]
    results = [_describe_trial(trial) for trial in trials]
    refused = sum(trial["verdict"] == "refused" for trial in trials)
    counts = f"{len(trials)} ids of {len(tried)} packages: {len(trials) - refused} played, proven and exported"
    text = _PAGE.format(
        counts=counts,
        refused=refused,
        date=record["date"],
        python=record["python"],
        numpy=record["versions"]["numpy"],
        steps=record["steps"],
        rules="\n".join(rules),
        results="\n".join(results),
    )
    page.write_text(text, encoding="utf-8")


def _describe_family(family: Family) -> str:
    ids = ", ".join(f"`{name}`" for name in family.ids)
    success = f"`{family.success}`" if family.success else "-"
    linked = f"[{family.reason}]({family.source})" if family.source.startswith("https") else family.reason
    return f"| `{family.package}` | {ids} | {success} | {linked} |"


def _describe_trial(trial: Mapping[str, str]) -> str:
    if trial["verdict"] == "refused":
        fate = f"refused: {trial['refused_because'].replace('|', '&#124;')}"
    else:
        fate = f"played, proven, in {trial['exports']} formats"
        if trial["exports_refused"]:
            fate += f"; not in {trial['exports_refused'].replace('|', '&#124;')}"
    return f"| `{trial['package']}` {trial['version']} | `{trial['id']}` | {trial['check']} | {fate} |"


_PAGE = """# Public environments

Other people's environments, tried as a study has them: check, two episodes of at most {steps} steps, `minihuman verify`
and every exporter. {counts},
{refused} refused before any data, each for the reason below. `python analysis/public_environments.py` tries those that
are installed, and writes this page ({date}, Python {python}, numpy {numpy}; other versions are in the table).

## What success is

By hand, from their documentation. A block states `success` as the third column has it; where that is "-", what
[`minihuman check` finds](../docs/environments.md) is right: the table of Gymnasium's and ALE's own, or
`info["is_success"]` and `info["success"]`.

| package | ids | `success` | why |
|---|---|---|---|
{rules}

## What became of them

A short check plays 60 steps, as `serve` does before sessions; a full one is that of `minihuman check`: 300 steps, with
pictures and without, again from a saved state and in a second process.

| package | id | check | |
|---|---|---|---|
{results}
"""


def _find_version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def main() -> None:
    """Try, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", metavar="PACKAGE", help="Packages to try; all without it.")
    parser.add_argument("--ids", nargs="*", default=["*"], metavar="PATTERN", help="Ids to try.")
    parser.add_argument("--full", action="store_true", help="Check each as before a study begins, which takes longer.")
    parser.add_argument("--timeout", type=float, default=TIMEOUT_S, help="Seconds for each; more on a busy machine.")
    parser.add_argument("--out", type=Path, default=FOLDER, help="Folder to write into.")
    arguments = parser.parse_args()
    families = [family for family in read_families() if not arguments.only or family.package in arguments.only]
    os.environ[TRUST_VARIABLE] = ",".join({family.module for family in families})
    arguments.out.mkdir(parents=True, exist_ok=True)
    warm_up()
    for trial in try_all(families, arguments.ids, is_full=arguments.full, timeout_s=arguments.timeout):
        write_trial(trial, arguments.out)
    write_page(arguments.out, arguments.out / "public_environments.md")
    print(arguments.out / "public_environments.csv")


if __name__ == "__main__":
    main()
