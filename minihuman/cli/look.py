"""Commands that show data: status, info, replay, film, plot, report, query, bots."""

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
    print_note,
    print_result,
    selection_options,
)
from minihuman.errors import MinihumanError, escape_control_characters, name_output_when_full


def status(
    study: StudyFolder,
    due: Annotated[bool, Option("--due", help="List only participants who are due for their next session.")] = False,
    json: JsonOption = False,
) -> None:
    """Print the progress of a study's sessions.

    The exit status is 1 if a log is missing, if the end of a log is missing from the enrolment log, or if a session was
    completed twice.

    Example: minihuman status sessions/fourrooms-transfer --due
    """
    if due:
        from minihuman.admin.due import list_due_sessions

        due_sessions = list_due_sessions(study)
        lines = [session.line() for session in due_sessions] or ["no participant is due"]
        print_result(due_sessions, lambda: "\n".join(lines), json=json)
        return
    from minihuman.admin.local_copies import obey_withdrawals
    from minihuman.admin.status import format_status, read_study_status

    obey_withdrawals(study, say=print_note)
    study_status = read_study_status(study)
    print_result(study_status, lambda: "\n".join(format_status(study, study_status)), json=json)
    raise SystemExit(int(bool(study_status.problems)))


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
    if json:
        print(format_session_json(session))
    else:
        print(escape_control_characters("\n".join(format_session_lines(session))))


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

    Paths, keys, rewards and events are shown on common timelines. Unfinished episodes and those that the protocol's
    rules exclude are shown; those annotated `exclude` are not. Logs that cannot be read are named and skipped.

    Example: minihuman replay sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap --out replay.rrd
    """
    if out is not None and web:
        raise MinihumanError(
            f"--out {out} writes a file and opens no viewer, so --web has no effect; remove one of them"
        )
    from minihuman.dataset.sessions import read_selected_sessions
    from minihuman.replay.recording import save_recording, show_recording

    sessions, account = read_selected_sessions(logs, selection)
    print_account(account.lines())
    if out is not None:
        print(save_recording(sessions, out, with_view=view))
        return
    with tempfile.TemporaryDirectory() as folder:
        show_recording(save_recording(sessions, Path(folder) / "replay.rrd", with_view=view), web=web)


def film(
    log: LogFile,
    out: Annotated[Path, Option(help="The file to write: a film (.mp4, .webm or .gif) or a contact sheet (.png).")],
    episode: Annotated[int | None, Option(min=1, help="The number of the episode; by default, all episodes.")] = None,
) -> None:
    """Write a film of a session's episodes, or a contact sheet.

    Keys, reaction times and the map are shown beside the pictures, which the world draws again. For a world that is not
    minihuman's own, the command says whether they are proved to be what the participant saw.

    Example: minihuman film sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap --episode 3 --out episode-3.mp4
    """
    from minihuman.admin.verify.picture_verification import verify_pictures
    from minihuman.log.read.session_reader import read_log
    from minihuman.replay.film import write_film

    session = read_log(log)
    with name_output_when_full(out):
        print(write_film(session, out, episode=episode))
    pictures = verify_pictures(session)
    if pictures is not None:
        print(pictures)


@selection_options()
def plot(
    study: StudyOrLog,
    out: Annotated[Path, Option(help="The folder to write the figures to.")],
    every_session: Annotated[
        bool, Option("--each", help="Also draw the paths and the overview of every session.")
    ] = False,
    *,
    selection: Any,
) -> None:
    """Draw figures of a session or a study.

    For a session, draw its paths and an overview; for a study, draw where participants went and how they learned. Each
    figure is saved as PNG and PDF.

    Example: minihuman plot sessions/demo --out figures --each
    """
    from minihuman.dataset.log_files import infrequent_collection

    with infrequent_collection():
        from minihuman.dataset.tables import select
        from minihuman.figures.gallery import draw_all_figures

        tables = select(study, selection)
        with name_output_when_full(out):
            for path in draw_all_figures(tables, out, each_session=every_session):
                print(path, flush=True)
        print_account(tables.account.lines())


@selection_options()
def report(
    study: StudyFolder,
    out: Annotated[Path, Option(help="The folder to write the report to.")],
    template: Annotated[
        Path | None, Option(help="A folder with a report.html.j2 or report.css to use instead of the built-in one.")
    ] = None,
    r: Annotated[bool, Option("--r", help="Also write mixed models in R (lme4, brms) as analysis.R.")] = False,
    python: Annotated[
        bool, Option("--python", help="Also write mixed models in Python (statsmodels, Bambi) as analysis.py.")
    ] = False,
    *,
    selection: Any,
) -> None:
    """Write a study's report: tables, statistics and figures.

    Example: minihuman report sessions/fourrooms-transfer --out report
    """
    from minihuman.api import report as write_report

    scripts = [name for name, is_wanted in (("r", r), ("python", python)) if is_wanted]
    summary = write_report(study, out, selection=selection, template=template, scripts=scripts)
    for path in summary.files:
        print(path, flush=True)
    print_account(summary.notes)


def query(
    study: StudyFolder,
    sql: Annotated[str, Argument("A query in DuckDB's SQL.", "SQL")],
    csv: Annotated[bool, Option("--csv", help="Print every row as CSV.")] = False,
    json: Annotated[bool, Option("--json", help="Print every row as JSON.")] = False,
) -> None:
    """Query a study's tables with SQL.

    The tables are the same as in an export: steps, episodes, participants and others. They also contain excluded rows;
    exclusion_reason is null in included rows. The file tables.duckdb in the study's folder is a cache, which you can
    delete at any time.

    Example: minihuman query sessions/demo "select participant, avg(reward) from episodes group by all"
    """
    if csv and json:
        raise MinihumanError("--csv and --json cannot be used together; remove one of them")
    from minihuman.dataset.table_queries import format_result_csv, format_result_lines
    from minihuman.dataset.tables import answer_query, select

    with select(study) as tables:
        answer = answer_query(tables, sql)
    if json:
        print_json(answer.to_pylist())
    elif csv:
        print(format_result_csv(answer), end="")
    else:
        print("\n".join(format_result_lines(answer)))
    print_account((*(log.line() for log in tables.account.skipped), *tables.account.notes))


@selection_options(with_=("exclude", "rules", "unfinished"))
def bots(
    study: StudyOrLog,
    typing: Annotated[bool, Option("--typing", help="Also look at how answers were typed.")] = False,
    json: JsonOption = False,
    *,
    selection: Any,
) -> None:
    """Weigh whether a person or a program pressed the keys.

    A session is flagged if a program is at least 100 times as likely, or by a fact such as keys that a script made.
    Nothing is excluded: decide with `minihuman annotate LOG --tag exclude`. The ratio is not calibrated on people.

    Example: minihuman bots sessions/online
    """
    from minihuman.dataset.tables import select
    from minihuman.reporting.bots import NOT_CALIBRATED, weigh_sessions

    tables = select(study, selection)
    weighings = list(weigh_sessions(tables.read_sessions(), typing=typing))
    for weighing in weighings:
        if json:
            print_json(weighing)
            continue
        reasons = [*weighing.facts]
        if weighing.flagged:
            reasons += weighing.reasons
        print(escape_control_characters(weighing.line()))
        for reason in reasons:
            print(escape_control_characters(f"    {reason}"))
        if weighing.flagged and not weighing.decision:
            print(
                escape_control_characters(f"    to decide: minihuman annotate {weighing.log} --tag exclude (or person)")
            )
    print_account((NOT_CALIBRATED, *tables.account.lines()))
