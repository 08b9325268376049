"""Commands that keep and administer data: verify, recover, annotate, manifest, withdraw, replace, import, gather."""

import sys
from pathlib import Path
from typing import Annotated

from minihuman.cli.options import (
    Argument,
    EngineOption,
    ExperimenterOption,
    JsonOption,
    LogFile,
    Option,
    ReasonOption,
    StudyFolder,
    ask_reason,
    print_account,
    print_json,
    print_note,
)
from minihuman.errors import escape_control_characters

Code = Annotated[str, Argument("The participant's code, such as sub-07.", "CODE")]
StudyOption = Annotated[Path, Option("--study", help="The study's folder, such as sessions/fourrooms-transfer.")]
SampleOption = Annotated[
    str | None, Option(help="Replay only this share of the sessions, drawn at random, such as 5%.")
]
SampleSeedOption = Annotated[int, Option(help="The seed with which the sample is drawn.")]
RecordOption = Annotated[
    Path | None,
    Option(
        help="Record in this file which logs were verified, and replay only new and changed ones, so that a run that "
        "was cut off goes on."
    ),
]
TrustWorldsOption = Annotated[
    bool, Option("--trust", help="Trust the modules of the logs' worlds from now on, so that they may be imported.")
]
PoliciesOption = Annotated[
    bool,
    Option("--policies", help="Recompute the agents' actions from their policy files, and compare them with the logs."),
]


def verify(
    logs: Annotated[list[Path], Argument("Session logs or a page's data, or folders of logs.", "LOG...")],
    manifest: Annotated[
        str | None,
        Option("--manifest", "--seal", help="Compare the files with this manifest, given as a file or by its digest."),
    ] = None,
    trust: TrustWorldsOption = False,
    policies: PoliciesOption = False,
    tables: Annotated[
        bool, Option("--tables", help="Recompute a study's tables from its logs, and check the cached ones.")
    ] = False,
    report: Annotated[
        list[Path] | None,
        Option(help="With --tables, also check the report or export in this folder; repeatable."),
    ] = None,
    engine: EngineOption = "local",
    sample: SampleOption = None,
    sample_seed: SampleSeedOption = 0,
    record: RecordOption = None,
    json: Annotated[bool, Option("--json", help="Print one JSON object per line.")] = False,
) -> None:
    """Replay logs from their seeds and inputs; report any difference.

    The exit status is 1 if anything differs, and 2 if a log cannot be read.
    With --tables, every cell of every table is recomputed from the logs.

    Example: minihuman verify sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    from minihuman.api import verify as verify_logs

    code = 0
    checks = verify_logs(
        *logs,
        manifest=manifest,
        trust=trust,
        policies=policies,
        tables=tables,
        outputs=report or (),
        engine=engine,
        sample=sample,
        sample_seed=sample_seed,
        record=record,
    )
    for finding in checks:
        if finding.error:
            code = max(code, finding.error.exit_code)
        elif not finding.ok:
            code = max(code, 1)
        if json:
            print_json({"log": finding.log, "fine": finding.ok, "said": finding.text})
        elif finding.error:
            print(escape_control_characters(f"minihuman: {finding.text}"), file=sys.stderr, flush=True)
        else:
            print(escape_control_characters(f"{finding.log}: {finding.text}"), flush=True)
    raise SystemExit(code)


def recover(
    logs: Annotated[list[Path], Argument("Cut-off or damaged logs, or folders of cut-off ones.", "LOG...")],
    reason: ReasonOption = "",
    experimenter: ExperimenterOption = "",
    archive: Annotated[
        Path | None, Option("--archive", help="Only copy whole logs into this folder, without their message index.")
    ] = None,
) -> None:
    """Complete interrupted logs and repair damaged ones.

    Print what was recovered from each log. If the enrolment log lacks the end of a complete log, add it. The exit
    status is 1 if a log was damaged.

    Example: minihuman recover sessions/fourrooms-transfer
    """
    from minihuman.admin.enrolment_entries import AuditNote
    from minihuman.admin.log_info import recover_logs
    from minihuman.errors import MinihumanError

    if archive is not None:
        from minihuman.log.record.finalization import archive_log

        archive.mkdir(parents=True, exist_ok=True)
        for log in logs:
            print(archive_log(log, archive))
        return
    codes = [0]
    for outcome in recover_logs(logs, AuditNote(ask_reason(reason), experimenter)):
        if isinstance(outcome, MinihumanError):
            print(escape_control_characters(f"minihuman: {outcome}"), file=sys.stderr, flush=True)
            codes.append(outcome.exit_code)
        else:
            print(escape_control_characters(outcome.line), flush=True)
            codes.append(int(outcome.damaged))
    if len(codes) == 1:
        print("no cut-off logs")
    raise SystemExit(max(codes))


def annotate(
    log: LogFile,
    tag: Annotated[str, Option(help="The tag, a lower-case word such as `exclude`.")],
    episode: Annotated[
        int | None, Option(help="The number of the episode; by default, annotate the whole session.")
    ] = None,
    note: Annotated[
        str,
        Option(
            "--note", "--reason", help="The reason; if omitted in an interactive terminal, you are prompted for it."
        ),
    ] = "",
    take_back: Annotated[bool, Option("--take-back", help="Take back an earlier annotation with this tag.")] = False,
    experimenter: ExperimenterOption = "",
) -> None:
    """Annotate an episode or a session.

    The annotation is written to a file beside the log; the log does not change.

    Example: minihuman annotate sub-01_ses-01.mcap --episode 3 --tag exclude --note "the phone rang"
    """
    from minihuman.dataset.annotations import Annotation, add_annotation
    from minihuman.log.read.session_reader import read_log
    from minihuman.storage.system import now_text

    session = read_log(log)
    note = ask_reason(note)
    print(add_annotation(session, Annotation(tag, now_text(), episode, note, take_back, experimenter)))


def manifest(study: StudyFolder) -> None:
    """Write a study's manifest and print its digest.

    Publish the digest, so that `minihuman verify --manifest DIGEST` can detect any later change to a file.

    Example: minihuman manifest sessions/fourrooms-transfer
    """
    from minihuman.admin.manifest import write_manifest

    print(write_manifest(study).digest)


def withdraw(
    code: Code,
    study: StudyOption,
    erase: Annotated[bool, Option("--erase", help="Delete the participant's data.")] = False,
    archive: Annotated[
        Path | None,
        Option("--archive", "--seal", help="Move the participant's data to this ZIP archive outside the study."),
    ] = None,
    reason: ReasonOption = "",
    experimenter: ExperimenterOption = "",
) -> None:
    """Withdraw a participant and free their slot.

    All later tables, reports and exports exclude the participant's data.

    Example: minihuman withdraw sub-07 --study sessions/fourrooms-transfer --erase
    """
    from minihuman.admin.enrolment_entries import AuditNote
    from minihuman.admin.withdrawal import withdraw_participant
    from minihuman.errors import AllocationError

    if erase == (archive is not None):
        raise AllocationError(
            "choose what happens to the participant's data: add either --erase or --archive ARCHIVE.zip"
        )
    withdrawal = withdraw_participant(study, code, seal=archive, note=AuditNote(ask_reason(reason), experimenter))
    print(withdrawal.line())
    print("The next participant gets their slot. Make reports, figures and exports again: they hold their data.")
    print("Folders that `minihuman gather --tables` filled hold it, too, until it is run again.")
    for line in withdrawal.left:
        print(escape_control_characters(line))


def replace(code: Code, study: StudyOption, reason: ReasonOption = "", experimenter: ExperimenterOption = "") -> None:
    """Free the slot of a participant who dropped out; keep their data.

    Example: minihuman replace sub-07 --study sessions/fourrooms-transfer
    """
    from minihuman.admin.enrolment_entries import AuditNote
    from minihuman.admin.withdrawal import replace_participant

    replace_participant(study, code, AuditNote(ask_reason(reason), experimenter))
    print(f"the next `minihuman run` offers {code}'s slot")


def _import_site(files: list[Path], study: Path, protocol: Path, *, json: bool) -> int:
    """Import records of a site's pages into a study, and print a line or a JSON object for each.

    Returns:
        The exit status: 0, or the highest one of the records that were refused.
    """
    from minihuman.study_site import describe_site_slots, import_site_data

    code = 0
    for imported in import_site_data(*files, study=study, protocol=protocol):
        if imported.error:
            code = max(code, imported.error.exit_code)
        if json:
            print_json(
                {
                    "record": imported.id,
                    "log": imported.log,
                    "screens": imported.screens,
                    "differences": imported.differences,
                    "refused": imported.error is not None,
                    "said": imported.text,
                }
            )
        else:
            print(escape_control_characters(imported.text), flush=True)
    if not json:
        print(describe_site_slots(study, protocol))
    return code


def import_(
    files: Annotated[list[Path], Argument("Files of a page's data (.json, .csv), or folders of them.", "DATA...")],
    study: Annotated[Path, Option("--study", help="The study's folder; it is made if it does not exist.")],
    protocol: Annotated[
        Path | None, Option("--protocol", help="The protocol of the site that recorded the data (`minihuman site`).")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Import episodes that a web page recorded without a server.

    Each file is a participant's session. Its episodes are replayed, and a file that differs is refused. With
    `--protocol`, data are records of a site: the session runs again by the page's messages, and differences are
    reported. The logs say that they are consistent, not witnessed. The exit status is 1 if a file was refused.

    Example: minihuman import data/ --study sessions/online-maze
    """
    from minihuman.api import import_page_data

    if protocol is not None:
        raise SystemExit(_import_site(files, study, protocol, json=json))
    code = 0
    for imported in import_page_data(*files, study=study):
        if imported.error:
            code = max(code, imported.error.exit_code)
        if json:
            print_json(
                {
                    "file": imported.file,
                    "log": imported.log,
                    "episodes": imported.episodes,
                    "steps": imported.steps,
                    "refused": imported.error is not None,
                    "said": imported.text,
                }
            )
        elif imported.error:
            print(escape_control_characters(f"minihuman: {imported.text}"), file=sys.stderr, flush=True)
        else:
            print(escape_control_characters(f"{imported.file}: {imported.text}"), flush=True)
    raise SystemExit(code)


def gather(
    study: Annotated[
        str, Argument("A study's folder or, with --tables, a store of tables such as s3://bucket/prefix.", "STUDY")
    ],
    tables: Annotated[
        Path | None, Option("--tables", help="Only bring the tables from their store to this folder, without logs.")
    ] = None,
    lost_machine: Annotated[
        str,
        Option(
            "--lost-machine",
            help="The number of a machine that no longer exists, as in `minihuman status`; withdrawals wait for it no "
            "longer.",
        ),
    ] = "",
) -> None:
    """Synchronize a study's logs and tables with the remote stores.

    Logs and annotations come and go; tables of new and changed sessions are stored.

    Example: minihuman gather sessions/fourrooms-transfer
    """
    from minihuman.admin.erasure_ledger import declare_machine_lost
    from minihuman.admin.local_copies import obey_withdrawals
    from minihuman.admin.recorded_outputs import TABLES, record_output
    from minihuman.admin.remote_logs import sync_logs
    from minihuman.dataset.remote_tables import fetch_tables, store_tables

    if tables is not None:
        n_fetched, removed = fetch_tables(study, tables, say=print_note)
        print_account(filter(None, [record_output(Path(study), TABLES, tables)]))  # "" if a withdrawal finds them
        print(f"{n_fetched} files of tables fetched, {removed} removed in {tables}")
        return
    folder = Path(study).absolute()
    if lost_machine:
        declare_machine_lost(folder, lost_machine, say=print)
    obey_withdrawals(folder, ask_store=True, say=print_note)
    n_fetched, n_stored = sync_logs(folder.parent, f"{folder.name}/", say=print_note)
    print(f"{n_fetched} logs fetched, {n_stored} stored")
    if (counts := store_tables(folder, say=print_note)) is not None:
        print(f"{counts[0]} files of tables stored, {counts[1]} removed")
