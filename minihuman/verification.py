"""Verify logs and studies: replay logs, recompute tables or compare files, and report every finding.

Modules that only one way of verifying needs are imported when it is called: comparing files with a manifest replays
nothing.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.errors import MinihumanError

if TYPE_CHECKING:
    from minihuman.admin.verify.coverage import Sample, VerificationRecord

_PAGE_DATA_SUFFIXES = (".json", ".csv")
_LOGS_PER_PROCESS = 8  # fewer logs are replayed in less time than another process needs to start


@dataclass(frozen=True, slots=True)
class VerificationLine:
    """One finding about one log."""

    log: Path
    text: str
    ok: bool
    error: MinihumanError | None = None  # why the log cannot be read or checked


def verify(
    *paths: Path | str,
    manifest: str | None = None,
    trust: bool = False,
    policies: bool = False,
    tables: bool = False,
    outputs: Collection[Path | str] = (),
    engine: str = "local",
    sample: str | float | None = None,
    sample_seed: int = 0,
    record: Path | str | None = None,
) -> Iterator[VerificationLine]:
    """Replay logs from their seeds and inputs, and compare every message; for a study, also verify its enrolment log.

    Args:
        paths: session logs, folders of logs, or files of a page's episodes (.json, .csv); with a manifest, study
            folders.
        manifest: a digest or a manifest file, with which the files are compared instead of being replayed.
        trust: whether to trust the modules of the logs' worlds from now on.
        policies: whether to compare the agents' actions with their policy files, too.
        tables: whether to recompute the tables of study folders and compare the caches, instead of replaying logs.
        outputs: folders of reports and exports (CSV, Parquet) of the default selection to compare with these tables.
        engine: "local" to replay many logs in processes of this machine, or "ray" to replay them in a Ray cluster.
        sample: the share of the sessions to replay, such as "5%" or 0.05; every finding about one of them says so.
        sample_seed: the seed with which the sample is drawn.
        record: a file that records which logs were verified; new logs are added to it. A log in it is not replayed
            again if the log, its chain head in the enrolment log and this software are unchanged, so that an
            interrupted run can be continued.

    Yields:
        Findings. ``all(line.ok for line in verify(path))`` tells whether everything is as logged. A log that cannot be
        read yields a line with an ``error``, and the other logs are still verified.

    Raises:
        MinihumanError: if a manifest is combined with ``trust`` or ``policies``, ``outputs`` are given without exactly
            one study's tables, ``sample`` is not a share between 0 and 1, or nothing exists at a path.
    """
    has_options = trust or policies
    is_selective = sample is not None or record is not None
    _require_compatible(paths, outputs, manifest, tables=tables, has_options=has_options, is_selective=is_selective)
    yield from _obey_withdrawals(paths)
    checks: list[Iterable[VerificationLine]] = []
    replay = _plan_replay(engine, trust=trust, policies=policies, sample=sample, seed=sample_seed, record=record)
    for path in map(Path, paths):
        if tables:
            checks.append(_verify_tables(path, outputs))
        elif manifest is not None:
            checks.append(_verify_manifest(path, manifest))
        elif path.suffix.lower() in _PAGE_DATA_SUFFIXES and path.is_file():
            checks.append(_convert_findings(path, _verify_page_data(path)))
        else:
            checks += _list_log_checks(path, replay)
    yield from chain.from_iterable(checks)


def _require_compatible(
    paths: Sequence[Path | str],
    outputs: Collection[Path | str],
    manifest: str | None,
    *,
    tables: bool,
    has_options: bool,
    is_selective: bool,
) -> None:
    """Check that the arguments of `verify` can be combined.

    Args:
        paths: the paths to verify.
        outputs: the folders to compare with recomputed tables.
        manifest: the manifest to compare files with; None for none.
        tables: whether tables are recomputed.
        has_options: whether an option of replaying is set that does not choose logs.
        is_selective: whether only some logs are replayed: a sample, or those that a record lacks.

    Raises:
        MinihumanError: if two arguments exclude each other, or one needs another that is missing.
    """
    has_replay = manifest is None and not tables
    if is_selective and not has_replay:
        raise MinihumanError(
            "--sample and --record select logs to replay; use --manifest and --tables in a separate command"
        )
    if manifest is not None and has_options:
        raise MinihumanError("--manifest only compares files; use --trust or --policies in a separate command")
    if tables and (manifest is not None or has_options):
        raise MinihumanError(
            "--tables does not replay logs; use --manifest, --trust or --policies in a separate command"
        )
    if outputs and (not tables or len(paths) != 1):
        raise MinihumanError(
            "--report needs --tables and exactly one study; run: minihuman verify STUDY --tables --report FOLDER"
        )


@dataclass(frozen=True, slots=True)
class _Replay:
    """The settings of replaying logs, and the rules for which logs are replayed.

    Attributes:
        verify_log: replays a log and returns the findings.
        processes: the largest number of processes; None for as many as suit the machine.
        engine: "local" or "ray", as for `verify`.
        sample: the sample of the logs to replay; None for all.
        record: the record of earlier findings; None for none.
    """

    verify_log: Callable[[Path], "_LogFindings"]
    processes: int | None
    engine: str
    sample: "Sample | None" = None
    record: "VerificationRecord | None" = None


@dataclass(frozen=True, slots=True)
class _LogFindings:
    """The findings about a log, and whether they are sure to recur while the log and this software are unchanged."""

    lines: list[VerificationLine]
    can_repeat: bool  # False after a failure, and for worlds of other packages, which can change


def _plan_replay(
    engine: str, *, trust: bool, policies: bool, sample: str | float | None, seed: int, record: Path | str | None
) -> _Replay:
    """Return the settings of replaying logs, from the arguments of `verify`.

    Raises:
        MinihumanError: if the sample is not a share between 0 and 1, its seed is negative, or the record is a file of
            another kind.
    """
    replay = _Replay(
        verify_log=partial(_verify_log, trust=trust, policies=policies),
        processes=1 if trust else None,  # since trusting a log's modules writes to the one record of trust
        engine=engine,
    )
    if sample is None and record is None:
        return replay
    from minihuman.admin.verify.coverage import Sample, VerificationRecord

    return replace(
        replay,
        sample=None if sample is None else Sample.parse(str(sample), seed=seed),
        record=None if record is None else VerificationRecord(Path(record), "policies" if policies else ""),
    )


def _list_log_checks(path: Path, replay: _Replay) -> Iterator[Iterable[VerificationLine]]:
    """Yield iterables of findings: about the logs at a path, then about its studies. Each runs when it is iterated.

    Raises:
        LogError: if the path holds neither logs nor studies.
    """
    from minihuman.admin.verify.episodes import verify_teams
    from minihuman.admin.verify.study import find_sessions, find_studies, verify_enrolment

    studies = find_studies(path)
    logs = find_sessions(path, required=not studies)
    if replay.sample is None:
        yield _replay_logs(logs, replay)
    else:
        yield _replay_sample(path, logs, replay, replay.sample)
    yield from (_convert_findings(study, verify_enrolment(study)) for study in studies)
    yield from (_convert_findings(study, verify_teams(study)) for study in studies)


def _replay_sample(path: Path, logs: Sequence[Path], replay: _Replay, sample: "Sample") -> Iterator[VerificationLine]:
    """Yield the findings about a sample of logs, and then how many logs were not verified.

    Each finding that reports success also says that it is about a sample.

    Args:
        path: the path that holds the logs.
        logs: the logs from which the sample is drawn.
        replay: the settings of replaying.
        sample: the sample.
    """
    drawn = sample.draw(logs)
    description = sample.describe(len(drawn), len(logs))
    for finding in _replay_logs(drawn, replay):
        if finding.ok:
            yield replace(finding, text=f"{finding.text} ({description})")
        else:
            yield finding
    yield VerificationLine(
        path, f"replayed {description}; the other {len(logs) - len(drawn)} were not verified", ok=True
    )


def _replay_logs(logs: Sequence[Path], replay: _Replay) -> Iterator[VerificationLine]:
    """Yield the findings about logs: the recorded ones if there are any, and otherwise those of replaying the log."""
    from minihuman.dataset.log_files import map_paths

    recorded: dict[Path, tuple[str, ...]] = {}
    if replay.record is not None:
        recorded = _find_recorded(logs, replay.record)
    new_findings = map_paths(
        [log for log in logs if log not in recorded],
        replay.verify_log,
        processes=replay.processes,
        engine=replay.engine,
        per_process=_LOGS_PER_PROCESS,
    )
    for log in logs:
        if log in recorded:
            yield from (VerificationLine(log, text, ok=True) for text in recorded[log])
            continue
        findings = next(new_findings)
        if replay.record is not None and findings.can_repeat and all(line.ok for line in findings.lines):
            replay.record.add(log, [line.text for line in findings.lines])
        yield from findings.lines


def _find_recorded(logs: Sequence[Path], record: "VerificationRecord") -> dict[Path, tuple[str, ...]]:
    """Return the texts of the recorded findings, by log, for each log that is unchanged since it was recorded."""
    from minihuman.admin.verify.log import find_chain_heads

    recorded = {}
    for log in logs:
        texts = record.find(log, find_chain_heads(log))
        if texts is not None:
            recorded[log] = texts
    return recorded


def _verify_tables(study: Path, outputs: Iterable[Path | str]) -> Iterator[VerificationLine]:
    from minihuman.reporting.recomputation import verify_tables

    return _convert_findings(study, verify_tables(study, [Path(output) for output in outputs]))


def _verify_manifest(study: Path, manifest: str) -> Iterator[VerificationLine]:
    from minihuman.admin.verify.study import verify_manifest

    return _convert_findings(study, verify_manifest(study, manifest))


def _obey_withdrawals(paths: Iterable[Path | str]) -> Iterator[VerificationLine]:
    """Erase this machine's copies of participants who withdrew from the studies at these paths; yield what was done.

    Each line reports success, even if it states what could not be erased.
    """
    from minihuman.admin.local_copies import obey_withdrawals
    from minihuman.admin.verify.study import find_studies

    studies: dict[Path, None] = {}  # a dict instead of a set, to keep the order of the paths
    for path in paths:
        studies |= dict.fromkeys(find_studies(Path(path)))
    for study in studies:
        lines: list[str] = []
        obey_withdrawals(study, say=lines.append)
        yield from (VerificationLine(study, line, ok=True) for line in lines)


def _verify_page_data(file: Path) -> Iterator[tuple[str, bool]]:
    from minihuman.web.page_data.imports import verify_page_data

    yield from verify_page_data(file)


def _verify_log(log: Path, *, trust: bool, policies: bool) -> _LogFindings:
    """Replay a log and return the findings; ``trust`` and ``policies`` are those of `verify`."""
    from minihuman.admin.verify.log import is_of_our_worlds, verify_session

    lines = list(_convert_findings(log, verify_session(log, trust=trust, policies=policies)))
    can_repeat = all(line.ok for line in lines) and is_of_our_worlds(log)
    return _LogFindings(lines, can_repeat)


def _convert_findings(path: Path, findings: Iterable[tuple[str, bool]]) -> Iterator[VerificationLine]:
    """Yield findings (text, ok) about a path as lines; an error ends them with a line that describes it."""
    try:
        for text, ok in findings:
            yield VerificationLine(path, text, ok)
    except MinihumanError as error:
        yield VerificationLine(path, str(error), ok=False, error=error)
