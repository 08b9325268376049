"""Verify logs and studies: replay logs, recompute tables or compare files, and report every finding.

Modules that only one way of verifying needs are imported when it is called: comparing files with a manifest replays
nothing.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

from minihuman.errors import MinihumanError

_PAGE_DATA_SUFFIXES = (".json", ".csv")
_LOGS_PER_PROCESS = 8  # to verify; fewer are replayed sooner than one more process starts


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

    Yields:
        Findings. ``all(line.ok for line in verify(path))`` tells whether everything is as logged. A log that cannot be
        read
        yields a line with an ``error``, and the other logs are still verified.

    Raises:
        MinihumanError: if a manifest is combined with ``trust`` or ``policies``, ``outputs`` are given without exactly
            one study's tables, or nothing exists at a path.
    """
    if manifest is not None and (trust or policies):
        raise MinihumanError("--manifest only compares files; use --trust or --policies in a separate command")
    if tables and (manifest is not None or trust or policies):
        raise MinihumanError(
            "--tables does not replay logs; use --manifest, --trust or --policies in a separate command"
        )
    if outputs and (not tables or len(paths) != 1):
        raise MinihumanError(
            "--report needs --tables and exactly one study; run: minihuman verify STUDY --tables --report FOLDER"
        )
    yield from _obey_withdrawals(paths)
    checks: list[Iterable[VerificationLine]] = []
    verify_log = partial(_verify_log, trust=trust, policies=policies)
    processes = 1 if trust else None  # what is trusted is one file
    for path in map(Path, paths):
        if tables:
            checks.append(_verify_tables(path, outputs))
        elif manifest is not None:
            checks.append(_verify_manifest(path, manifest))
        elif path.suffix.lower() in _PAGE_DATA_SUFFIXES and path.is_file():
            checks.append(_name_findings(path, _verify_page_data(path)))
        else:
            checks += _list_log_checks(path, verify_log, processes=processes, engine=engine)
    yield from chain.from_iterable(checks)


def _list_log_checks(
    path: Path, verify_log: Callable[[Path], list[VerificationLine]], *, processes: int | None, engine: str
) -> Iterator[Iterable[VerificationLine]]:
    """Yield the checks of the logs at a path, then those of its studies; each runs when it is iterated over.

    Raises:
        LogError: if the path holds neither logs nor studies.
    """
    from minihuman.admin.verify.episodes import verify_teams
    from minihuman.admin.verify.study import find_sessions, find_studies, verify_enrolment
    from minihuman.dataset.log_files import map_paths

    studies = find_studies(path)
    logs = find_sessions(path, required=not studies)
    findings = map_paths(logs, verify_log, processes=processes, engine=engine, per_process=_LOGS_PER_PROCESS)
    yield chain.from_iterable(findings)
    yield from (_name_findings(study, verify_enrolment(study)) for study in studies)
    yield from (_name_findings(study, verify_teams(study)) for study in studies)


def _verify_tables(study: Path, outputs: Iterable[Path | str]) -> Iterator[VerificationLine]:
    from minihuman.reporting.recomputation import verify_tables

    return _name_findings(study, verify_tables(study, [Path(output) for output in outputs]))


def _verify_manifest(study: Path, manifest: str) -> Iterator[VerificationLine]:
    from minihuman.admin.verify.study import verify_manifest

    return _name_findings(study, verify_manifest(study, manifest))


def _obey_withdrawals(paths: Iterable[Path | str]) -> Iterator[VerificationLine]:
    from minihuman.admin.local_copies import obey_withdrawals
    from minihuman.admin.verify.study import find_studies

    studies: dict[Path, None] = {}  # each once, in order
    for path in paths:
        studies |= dict.fromkeys(find_studies(Path(path)))
    for study in studies:
        lines: list[str] = []
        obey_withdrawals(study, say=lines.append)
        yield from (VerificationLine(study, line, ok=True) for line in lines)


def _verify_page_data(file: Path) -> Iterator[tuple[str, bool]]:
    from minihuman.web.page_data.imports import verify_page_data

    yield from verify_page_data(file)


def _verify_log(log: Path, *, trust: bool, policies: bool) -> list[VerificationLine]:
    from minihuman.admin.verify.log import verify_session

    return list(_name_findings(log, verify_session(log, trust=trust, policies=policies)))


def _name_findings(path: Path, findings: Iterable[tuple[str, bool]]) -> Iterator[VerificationLine]:
    try:
        for text, ok in findings:
            yield VerificationLine(path, text, ok)
    except MinihumanError as error:
        yield VerificationLine(path, str(error), ok=False, error=error)
