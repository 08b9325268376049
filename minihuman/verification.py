"""Verify logs and studies: replay logs, or recompute tables and compare files, and name every finding.

What only one way of verifying needs is imported when it is called: comparing files with a manifest replays nothing.
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
    """Replay logs from their seeds and inputs, and compare every message; of a study also its enrolment log.

    Args:
        paths: session logs, or folders of them, and files of a page's episodes (.json, .csv); with a manifest, study
            folders.
        manifest: a digest or manifest file; then only the files are compared with it.
        trust: trust the modules of the logs' worlds, now and from now on.
        policies: compare the agents' actions with their policy files, too.
        tables: instead of replaying, recompute every table of study folders from their logs, and compare the caches.
        outputs: folders of reports and of CSV and Parquet exports, made of all that is included by default; they are
            compared with what is recomputed, too.
        engine: replays many logs in processes of this machine (local) or in a Ray cluster (ray).

    Yields:
        Findings. ``all(line.ok for line in verify(path))`` says whether everything is as logged. A log that cannot be
        read is a line with an ``error`` and does not hold up the others.

    Raises:
        MinihumanError: if a manifest is combined with ``trust`` or ``policies``, ``outputs`` are not compared with
            one study's tables, or nothing is at a path.
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
    """Yield the checks of the logs at a path, then of its studies; each is made when it is gone through.

    Raises:
        LogError: if nothing is there.
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

    for study in dict.fromkeys(study for path in paths for study in find_studies(Path(path))):
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
