"""Commands that show data: status, info, replay, plot, report, query."""

import tempfile
from pathlib import Path
from typing import Annotated, Any

from minihuman.cli.options import (
    Argument,
    JsonOption,
    LogFile,
    Option,
    StudyFolder,
    StudyOrLog,
    print_account,
    print_json,
    selection_options,
)
from minihuman.errors import MinihumanError, escape_control_characters, name_output_when_full
from minihuman.garbage_collection import infrequent_collection


def status(
    study: StudyFolder,
    due: Annotated[bool, Option("--due", help="List only participants who are due for their next session.")] = False,
    json: JsonOption = False,
) -> None:
    """Print the progress of a study's sessions.

    The exit status is 1 if a log is missing, or if its end is not in the enrolment log.

    Example: minihuman status sessions/fourrooms-transfer --due
    """
    if due:
        from datetime import datetime

        from minihuman.admin.due import list_due_sessions as expected

        found = expected(study, datetime.now().astimezone().date())
        if json:
            print_json(found)
        else:
            lines = [one.line() for one in found] or ["no participant is due"]
            print(escape_control_characters("\n".join(lines)))
        return
    if json:
        from minihuman.admin.status import read_study_status

        found_status = read_study_status(study)
        print_json(found_status)
        raise SystemExit(int(bool(found_status.problems)))
    from minihuman.admin.status import format_status, list_problems

    for line in format_status(study):
        print(escape_control_characters(line))
    raise SystemExit(int(bool(list_problems(study))))


def info(
    log: LogFile,
    json: JsonOption = False,
) -> None:
    """Describe a session's log.

    Example: minihuman info sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    from minihuman.admin.log_info import format_session_json, format_session_lines
    from minihuman.log.read.session_reader import read_log

    session = read_log(log)
    print(format_session_json(session) if json else escape_control_characters("\n".join(format_session_lines(session))))


@selection_options(with_=("unfinished", "rules"))
def replay(
    logs: Annotated[list[Path], Argument("Session logs, or folders of them.", "LOG...")],
    out: Annotated[
        Path | None, Option("--out", "--save", help="Write the recording to this file instead of opening the viewer.")
    ] = None,
    web: Annotated[bool, Option("--web", help="Open the viewer in a browser, served on 127.0.0.1 only.")] = False,
    view: Annotated[bool, Option(help="Also render what the participant saw, and compare it with the log.")] = False,
    *,
    selection: Any,
) -> None:
    """Replay sessions in the Rerun viewer.

    Paths, keys, rewards and events share their timelines. Unfinished episodes and those that the protocol's rules
    exclude are shown; those annotated `exclude` are not. Logs that cannot be read are named and skipped.

    Example: minihuman replay sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap --out replay.rrd
    """
    if out is not None and web:
        raise MinihumanError(f"--out {out} opens nothing, so --web shows nothing; remove one of the two")
    from minihuman.dataset.sessions import read_selected_sessions
    from minihuman.replay.recording import save_recording, show_recording

    sessions, account = read_selected_sessions(logs, selection)
    print_account(account.lines())
    if out is not None:
        print(save_recording(sessions, out, with_view=view))
        return
    with tempfile.TemporaryDirectory() as folder:
        show_recording(save_recording(sessions, Path(folder) / "replay.rrd", with_view=view), web=web)


@selection_options()
def plot(
    study: StudyOrLog,
    out: Annotated[Path, Option(help="The folder of the figures.")],
    each: Annotated[bool, Option("--each", help="Also draw the paths and the overview of every session.")] = False,
    *,
    selection: Any,
) -> None:
    """Draw figures of a session or a study.

    Draw a session's paths and overview, or where a study's participants went and how they learned; as PNG and PDF.

    Example: minihuman plot sessions/demo --out figures --each
    """
    with infrequent_collection():
        from minihuman.dataset.sessions import StudySessions
        from minihuman.figures.gallery import draw_all_figures

        sessions = StudySessions(study, selection)
        with name_output_when_full(out):
            for path in draw_all_figures(sessions, out, each=each):
                print(path, flush=True)
        print_account(sessions.account.lines())


@selection_options()
def report(
    study: StudyFolder,
    out: Annotated[Path, Option(help="The folder of the report.")],
    template: Annotated[
        Path | None, Option(help="A folder with a report.html.j2 or report.css to use instead of minihuman's.")
    ] = None,
    *,
    selection: Any,
) -> None:
    """Write a study's report: tables, statistics, figures.

    Example: minihuman report sessions/fourrooms-transfer --out report
    """
    from minihuman.workflow import report as write_report

    written = write_report(study, out, selection=selection, template=template)
    for path in written.files:
        print(path, flush=True)
    print_account(written.notes)


def query(
    study: StudyFolder,
    sql: Annotated[str, Argument("A query in DuckDB's SQL.", "SQL")],
    csv: Annotated[bool, Option("--csv", help="Print every row as CSV.")] = False,
    json: Annotated[bool, Option("--json", help="Print every row as JSON.")] = False,
) -> None:
    """Query a study's tables in SQL.

    The tables are steps, episodes, participants and the others of an export. Excluded rows are there too;
    exclusion_reason is null in included rows. The file tables.duckdb in the study's folder is a cache and may be
    deleted at any time.

    Example: minihuman query sessions/demo "select participant, avg(reward) from episodes group by all"
    """
    if csv and json:
        raise MinihumanError("--csv and --json are two formats of the same rows; remove one of the two")
    from minihuman.dataset.sessions import StudySessions
    from minihuman.dataset.store import StudyStore, find_queried_tables, format_result_csv, format_result_lines

    sessions = StudySessions(study)
    with StudyStore(sessions, with_shortest=True, tables=find_queried_tables(sql)) as store:
        found = store.tables.query(sql)
    if json:
        print_json(found.to_pylist())
    else:
        print(format_result_csv(found) if csv else "\n".join(format_result_lines(found)), end="" if csv else "\n")
    print_account((*(one.line() for one in sessions.account.skipped), *sessions.account.notes))
