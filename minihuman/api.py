"""The commands as functions: run, simulate, verify, export and report a study, and open what was recorded.

The commands of the same names call these functions. Modules that only one function needs are imported when it is
called, so that verifying a log opens no window and running a session reads no tables.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.errors import LogError
from minihuman.moved import forward_names
from minihuman.trust import Permission
from minihuman.verification import VerificationLine as VerificationLine, verify as verify

if TYPE_CHECKING:
    from minihuman.dataset.selection import Selection
    from minihuman.experiment.plan.session_plan import SessionPlan
    from minihuman.experiment.protocol.protocol import Protocol
    from minihuman.recorded_study import Session, Study
    from minihuman.web.page_data.imports import ImportedFile

Listener = Callable[[str], None]


def _ignore(_: str) -> None:
    """Do nothing with a line about progress; this is the default of the parameters that are called with such lines."""


@dataclass(frozen=True, slots=True)
class ExportSummary:
    """A summary of an export: its folder, the numbers of episodes and steps, and notes.

    Attributes:
        out: the export's folder; its README.md describes the contents.
        episodes: the number of included episodes.
        steps: the number of steps in these episodes.
        notes: what is included, what is excluded and why, and what the format cannot hold, one line per fact.
    """

    out: Path
    episodes: int
    steps: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ReportSummary:
    """A summary of what a report wrote.

    Attributes:
        page: the path of the report, a single HTML file.
        files: the paths of the page, its tables and its figures.
        notes: what is included, and what is excluded and why, one line per fact.
    """

    page: Path
    files: tuple[Path, ...]
    notes: tuple[str, ...]


def run(
    protocol: Path | str,
    *,
    participant: str | None = None,
    group: str | None = None,
    session: int = 1,
    any_day: bool = False,
    next_slot: bool = False,
    reason: str = "",
    experimenter: str = "",
    data: Path | str = "sessions",
    window: str = "auto",
    fullscreen: bool = True,
    lsl: bool = False,
    isolate_worlds: bool = False,
    trust: Permission = False,
    on_progress: Listener = _ignore,
    on_start: Listener = _ignore,
) -> Path | None:
    """Run a participant's session at this machine, or resume one.

    Args:
        protocol: the protocol's TOML file.
        participant: a code such as ``sub-07``, or several separated by commas if several people share this machine; by
            default the next free allocation slots are taken.
        group: a group that replaces the allocated one.
        session: the number of the session; 1 is the first.
        any_day: whether to ignore the days that the protocol requires between sessions.
        next_slot: whether to take the next free slot even if an interrupted session could be resumed.
        reason: why a participant, a group or the day is chosen by hand, for the audit trail.
        experimenter: the code of the experimenter who chooses.
        data: the folder that holds the studies' folders.
        window: the kind of window: ``auto``, ``pygame``, ``pyglet`` or a plug-in's name.
        fullscreen: whether to use the whole screen instead of a window.
        lsl: whether to send markers through the Lab Streaming Layer.
        isolate_worlds: whether to run third-party worlds in separate processes; worlds of teams stay in this one.
        trust: whether to trust the protocol's folder from now on and run its Python, or a function that asks this.
        on_progress: called with a text about what is being prepared; "" when the window is about to open.
        on_start: called with a line on each of: slots without a log, a slot once it is taken, further people's logs.

    Returns:
        The path of the session's log, or the first participant's if several share this machine; None if the session
        ended before anything had to be recorded, so the slot is free.

    Raises:
        ProtocolError: if the protocol is not valid, or runs Python that is not trusted.
        AllocationError: if no slot is free, this session may not be run now, or another must be resumed first.
        WindowError, DeviceError: if no window can be opened, or no sound device for a protocol with sounds.
        LogError: if the log cannot be written.
    """
    from minihuman.admin.enrolment_entries import AuditNote
    from minihuman.admin.legibility import require_legible
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.display.windows.blocking_window import open_window
    from minihuman.experiment.plan.dry_run import check_worlds
    from minihuman.runtime.agent_host import make_agent_host
    from minihuman.runtime.host import host_session
    from minihuman.runtime.machine import SessionClock
    from minihuman.runtime.shared_window import SharedWindow, host_team
    from minihuman.runtime.team_seating import count_seats_at_machine, require_one_process
    from minihuman.worlds.isolation.isolated_world import choose_world_factory

    protocol = Path(protocol)
    data = Path(data)
    study = read_protocol(protocol, trust=trust)
    if not participant and not next_slot:
        _require_no_interrupted_session(protocol, data, study)
    seats = count_seats_at_machine(study, group)
    require_one_process(study, f"on one machine; use minihuman serve {protocol}", group=group, at_one_machine=seats)
    codes = _split_codes(participant, seats)
    on_progress(f"preparing the worlds of {study.study.name}")
    check_worlds(study, str(protocol))
    require_legible(study, str(protocol))
    on_progress("")
    clock = SessionClock()
    opened = open_window(window, clock, fullscreen=fullscreen)
    try:  # the window first: a station without a display must not use up a slot
        if participant is None:
            _report_unused_slots(data / study.study.name, on_start)
        plan_session = partial(
            _plan_session,
            study,
            data,
            group=group,
            session=session,
            any_day=any_day,
            note=AuditNote(reason, experimenter),
            utc_offset_min=int(clock.facts()["utc_offset_min"]),
            on_start=on_start,
        )
        plans = [plan_session(code) for code in codes]
        if seats == 1:
            agent = make_agent_host(study, plans[0], data)
            with choose_world_factory(isolate_worlds) as make_world:
                return host_session(plans[0], opened, clock, data, markers=lsl, agent=agent, make_world=make_world)
        logs = host_team(study, plans, SharedWindow(opened, clock, seats), clock, data, markers=lsl)
        for log in logs[1:]:
            if log:
                on_start(f"log: {log}")
            else:
                on_start("a session ended before anything was recorded; its slot is free again")
        return logs[0]
    finally:
        opened.close()


def _split_codes(participant: str | None, seats: int) -> list[str] | list[None]:
    """Return the participant code for each seat at this machine; None for each if the next free slots are to be taken.

    Raises:
        AllocationError: if the number of codes is not the number of seats.
    """
    from minihuman.errors import AllocationError

    if not participant:
        return [None] * seats
    codes = participant.split(",")
    if len(codes) != seats:
        raise AllocationError(f"{participant!r} names {len(codes)} of {seats} people; give {seats} codes, with commas")
    return codes


def _require_no_interrupted_session(protocol: Path, data: Path, study: "Protocol") -> None:
    """Check that no interrupted session of the study is waiting to be resumed.

    Raises:
        AllocationError: if one is; the message has the command that resumes it, with the file ``protocol``.
    """
    from minihuman.admin.next_session import find_interrupted_session
    from minihuman.errors import AllocationError

    interrupted = find_interrupted_session(data / study.study.name)
    if interrupted is None:
        return
    command = f"minihuman run {protocol}"
    if data != Path("sessions"):
        command += f" --data {data}"
    command += f" --participant {interrupted.participant}"
    if interrupted.session > 1:
        command += f" --session {interrupted.session}"
    raise AllocationError(
        f"session {interrupted.session} of {interrupted.participant} was cut off after "
        f"{interrupted.episodes_completed} of {interrupted.episodes_planned} episodes; resume it: {command}; or take "
        "the next slot with --next-slot"
    )


def _report_unused_slots(study_folder: Path, on_start: Listener) -> None:
    """Call ``on_start`` with a line about the slots that were taken but have no log, if there are any."""
    from minihuman.admin.next_session import find_unused_slots

    unused = find_unused_slots(study_folder)
    if unused:
        on_start(
            f"{', '.join(unused)}: a slot and no log; if no session of theirs is running: "
            f"minihuman replace {unused[0]} --study {study_folder}"
        )


def _plan_session(
    study: "Protocol", data: Path, participant: str | None, *, on_start: Listener, **planning_options: Any
) -> "SessionPlan":
    """Take a slot and plan its session, as ``plan_next_session`` does with these options; report it with ``on_start``.

    Raises:
        DeviceError: if the study has sounds and no sound device opens; no slot is taken then.
    """
    from minihuman.admin.next_session import plan_next_session
    from minihuman.runtime.devices.sound import require_sound_device

    require_sound_device(study)
    plan = plan_next_session(study, data, participant=participant, **planning_options)
    if plan.participant.group:
        group = f"group {plan.participant.group}"
    else:
        group = "group not yet drawn"
    on_start(f"{plan.participant.id}, {group}, from episode {plan.first_episode + 1}")
    return plan


def simulate(
    protocol: Path | str,
    *,
    participants: int = 10,
    data: Path | str = "sessions",
    seed: int = 0,
    player: str = "human-like",
    parallel: int = 1,
    max_price: float = 0.0,
    isolate_worlds: bool = False,
    trust: Permission = False,
    on_progress: Listener = _ignore,
) -> Iterator[Path]:
    """Run a study with simulated participants, without a window and without waiting.

    This is an iterator: each session is played when its log is requested. ``list(simulate(...))`` plays them all.

    Args:
        protocol: the protocol's TOML file.
        participants: the number of simulated participants; they take the next free allocation slots.
        data: the folder that holds the studies' folders.
        seed: the random seed of the simulated participants.
        player: ``human-like``, ``optimal``, ``random``, ``exploring``, ``supervisor``, ``policy:FILE`` or a plug-in's
            name, with parameters as in ``human-like:lapse=0.1``; or ``model:NAME``, a language model at the endpoint
            given by ``OPENAI_BASE_URL`` and ``OPENAI_API_KEY``.
        parallel: the number of model sessions that are played at the same time.
        max_price: the price, in the protocol's currency, at which a model's sessions stop, to be resumed; 0: no limit.
        isolate_worlds: as for ``run``; the worlds of a model's sessions stay in this process.
        trust: as for ``run``.
        on_progress: called with a text about the progress.

    Yields:
        The path of each session's log.

    Raises:
        ProtocolError: if the protocol is not valid, or runs Python that is not trusted.
        AllocationError: if too few slots are free; no session has then been played.
        SimulationError: if there is no such player, or it cannot play a block's world.
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.experiment.plan.dry_run import check_worlds
    from minihuman.runtime.simulated_session import simulate as play
    from minihuman.worlds.isolation.isolated_world import choose_world_factory

    protocol = Path(protocol)
    data = Path(data)
    study = read_protocol(protocol, trust=trust)
    on_progress(f"{player} plays {study.study.name}")
    if player.startswith("model:") and player != "model:":
        yield from _simulate_models(study, data, participants, player, parallel, max_price, on_progress)
        return
    check_worlds(study, str(protocol))
    with choose_world_factory(isolate_worlds) as make_world:
        logs = play(study, data, participants=participants, seed=seed, player=player, make_world=make_world)
        for number, path in enumerate(logs, 1):
            yield path
            on_progress(f"{player} plays {study.study.name}: {number} of {participants} participants done")


def _simulate_models(
    study: "Protocol",
    data: Path,
    participants: int,
    player: str,
    parallel: int,
    max_price: float,
    on_progress: Listener,
) -> Iterator[Path]:
    """Play sessions with a language model as ``simulate`` does, yield each log's path, and report progress and cost."""
    from minihuman.runtime.model_run import ModelRun
    from minihuman.runtime.model_sessions import simulate_models
    from minihuman.simulation.model_conversation import SpentTotals

    n_done = 0
    currency = study.model.currency

    def report_costs(spent: SpentTotals) -> None:
        cost = f"{spent.price:.4f} {currency}".strip()
        on_progress(
            f"{player} plays {study.study.name}: {n_done} of {participants} participants done, {spent.calls} calls, "
            f"{spent.tokens} tokens, {cost}"
        )

    run = ModelRun.of_model(player, max_price=max_price, changed=report_costs)
    for path in simulate_models(study, data, participants=participants, parallel=parallel, run=run):
        n_done += 1
        report_costs(run.spent)
        yield path


def import_page_data(*paths: Path | str, study: Path | str) -> Iterator["ImportedFile"]:
    """Import episodes that a web page computed without a server, from jsPsych's JSON or CSV or from saved games.

    Each file is one participant's session. Its episodes are replayed from their seeds and actions. If nothing differs,
    the session machine writes them as a log that is marked as consistent, not witnessed. Files that were imported
    before are skipped.

    Args:
        paths: files, or folders of files.
        study: the study's folder, which may hold only imported sessions; it is created if it does not exist.

    Yields:
        The result for each file. ``error`` explains why a file was refused; the other files are still imported.

    Raises:
        MinihumanError: if a path has no page data.
    """
    from minihuman.web.page_data.imports import import_files

    yield from import_files(map(Path, paths), Path(study))


def export(
    format_name: str,
    study: Path | str,
    out: Path | str,
    *,
    selection: "Selection | None" = None,
    stored_frames: bool = False,
    with_messages: bool = False,
    engine: str = "local",
    on_progress: Listener = _ignore,
) -> ExportSummary:
    """Export a study or a log as tables, demonstrations or an archive.

    Args:
        format_name: csv, parquet, minari, lerobot or another format that ``minihuman plugins`` lists.
        study: a study's folder, or one log.
        out: the path of a folder that does not exist yet.
        selection: the rule for which sessions and episodes are included.
        stored_frames: whether to take observations from the logs instead of replaying; both are checked by hash.
        with_messages: whether an archive such as BIDS includes logs that hold messages between participants.
        engine: "local" to read logs for tables in processes of this machine, or "ray" to read them in a Ray cluster.
        on_progress: called with the path of each log.

    Raises:
        ExportError: if the format is unknown, the folder exists, nothing is included, or an episode does not replay.
        LogError: if the study cannot be read.
    """
    from minihuman.dataset.selection import Selection
    from minihuman.exporters.exporter import export_study
    from minihuman.exporters.recorded_exports import write_recorded_export

    write = partial(export_study, format_name, stored_frames=stored_frames, with_messages=with_messages, engine=engine)
    command = f"export {format_name}"
    result, notes = write_recorded_export(
        write, command, Path(study), Path(out), selection or Selection(), progress=lambda log: on_progress(str(log))
    )
    return ExportSummary(Path(out), result.episodes, result.steps, notes)


def publish(
    study: Path | str,
    archive: str,
    out: Path | str,
    *,
    selection: "Selection | None" = None,
    on_progress: Listener = _ignore,
) -> ExportSummary:
    """Write a folder to upload to a public archive: an export in the archive's format, a card, a citation and metadata.

    Facts that the protocol's ``[about]`` lacks are read from ``about.toml`` in the study's folder.

    Args:
        study: a study's folder.
        archive: osf, zenodo, hugging-face or openneuro.
        out: the path of a folder that does not exist yet.
        selection: the rule for which sessions and episodes are included.
        on_progress: called with the path of each log.

    Raises:
        ExportError: if the archive is unknown, a fact that it requires is missing, or for a reason of ``export``.
        LogError: if the study cannot be read.
    """
    from minihuman.dataset.selection import Selection
    from minihuman.exporters.publishing import write_publication

    result, notes = write_publication(
        Path(study), archive, Path(out), selection or Selection(), progress=lambda log: on_progress(str(log))
    )
    return ExportSummary(Path(out), result.episodes, result.steps, notes)


def report(
    study: Path | str,
    out: Path | str,
    *,
    selection: "Selection | None" = None,
    template: Path | str | None = None,
    scripts: Sequence[str] = (),
) -> ReportSummary:
    """Write a study's report: tables, statistics and figures.

    Args:
        study: the study's folder.
        out: the report's folder; files of an earlier report in it are replaced.
        selection: the rule for which sessions and episodes are included.
        template: a folder with a ``report.html.j2`` or ``report.css`` to use instead of the package's own.
        scripts: ``r`` and ``python``, to write mixed models as ``analysis.R`` and ``analysis.py`` beside the tables.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no log in the folder can be read, the logs are of different studies, or nothing can be modelled.
    """
    from minihuman.admin.local_copies import obey_withdrawals
    from minihuman.admin.recorded_outputs import record_output
    from minihuman.dataset.log_files import infrequent_collection
    from minihuman.dataset.tables import select
    from minihuman.errors import name_output_when_full
    from minihuman.reporting.build import build_report, find_stale_figures

    out = Path(out)
    withdrawal_notes: list[str] = []
    obey_withdrawals(Path(study), say=withdrawal_notes.append)
    with infrequent_collection(), name_output_when_full(out), select(Path(study), selection) as tables:
        files = build_report(tables, out, None if template is None else Path(template), scripts=scripts)
        unrecorded_note = record_output(Path(study), "report", out)  # "" if the output is recorded
        account = tables.account
        notes = (
            *withdrawal_notes,
            *account.lines(),
            *find_stale_figures(out, files),
            *account.notes,
            *filter(None, [unrecorded_note]),
        )
        return ReportSummary(files[0], files, notes)


def open_session(path: Path | str, selection: "Selection | None" = None) -> "Session":
    """Read a session from one log or its folder; ``selection`` is the rule for which episodes are included.

    Raises:
        LogError: if it cannot be read.
    """
    from minihuman.dataset.selection import Selection
    from minihuman.recorded_study import read_session

    return read_session(Path(path), selection or Selection())


def open_study(path: Path | str, selection: "Selection | None" = None) -> "Study":
    """Open a study's folder; ``selection`` is the rule for which sessions and episodes are included.

    Raises:
        LogError: if there is no such folder.
    """
    from minihuman.dataset.selection import Selection
    from minihuman.recorded_study import Study

    if not Path(path).is_dir():
        raise LogError(f"{path} is not a folder; name a study's folder, or open one log with open_session")
    return Study(Path(path), selection or Selection())


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
