"""Sessions with a language model as the participant: several in parallel, resumed after any interruption.

Every request is durable before it is sent. The answer and its effects become durable in this order, at the latest with
the session's next request, by the same fsync. A live file that a killed program left is resumed at the same call, so
that no stored answer is requested again.
"""

import time
from collections.abc import Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.enrolment_log import require_free_slots
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import LogError, SimulationError
from minihuman.experiment.machine.activity import find_kind, list_kinds
from minihuman.experiment.machine.events import (
    Event,
    ModelCall,
    SessionStarted,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.experiment.replay import resume_from_events
from minihuman.log.model.session_log import CUT_OFF
from minihuman.log.paths import LOG_SUFFIX, MODELS_FOLDER, PART_SUFFIX, list_log_files
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import LeftoverSegment, McapRecorder, resume_segment
from minihuman.moved import forward_names
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.model_run import ModelRun
from minihuman.runtime.model_window import ModelWindow, ResumableRecorder, SessionLeft
from minihuman.runtime.session_loop import describe_world_failure, run_session
from minihuman.runtime.team_seating import require_one_process
from minihuman.simulation.model_conversation import (
    ANSWER_RULES,
    ConversationRecord,
    find_picture_size,
)
from minihuman.storage.locks import hold_lock
from minihuman.worlds.adapters.world import World


def simulate_models(
    protocol: Protocol, data: Path, *, participants: int, parallel: int, run: ModelRun
) -> Iterator[Path]:
    """Play the sessions of ``participants`` models, ``parallel`` at a time and unfinished ones first; yield the logs.

    The models' study is kept in the folder ``models`` of the data folder. A model has the slot, the keys and the seeds
    of the participant with its number, and is never counted as a person.

    Raises:
        AllocationError: if there are too few free slots, before any session.
        ModelUnavailableError: if the model gives no answer; the same call resumes its sessions.
        RunStoppedError: if a limit of the run is reached.
        SimulationError: if the study has strata, or parts that a model cannot take.
    """
    require_playable(protocol)
    data = data / MODELS_FOLDER
    study_dir = data / protocol.study.name
    require_free_slots(protocol, study_dir, participants - len(list(_find_cut_off(study_dir, run.name))))
    run.make_client(protocol.model).close()  # an invalid address must not take up a slot
    waiting: set[Future[list[Path]]] = set()
    with ThreadPoolExecutor(parallel) as pool:
        try:
            for _ in range(participants):
                if len(waiting) == parallel:
                    waiting = yield from _yield_done(waiting)
                waiting.add(pool.submit(play_participant, protocol, data, run))
            while waiting:
                waiting = yield from _yield_done(waiting)
        except BaseException as error:
            reason = "another session failed" if isinstance(error, Exception) else "the run was interrupted"
            run.stop(reason)
            raise


def _yield_done(waiting: set[Future[list[Path]]]) -> Generator[Path, None, set[Future[list[Path]]]]:
    """Wait until a session is over; yield the logs of the sessions that are over, and return the others."""
    finished, unfinished = wait(waiting, return_when=FIRST_COMPLETED)
    for session in finished:
        yield from session.result()
    return unfinished


def require_playable(protocol: Protocol) -> None:
    """Refuse a study that a model cannot take part in.

    Raises:
        SimulationError: if the study has a part that a model cannot play, groups that are drawn after an answer, or a
            world that cannot be described in words although the model needs words.
    """
    require_one_process(protocol, "with a language model in a seat; give the other seats to agents")
    kinds = {block.kind for block in protocol.blocks} | {activity.kind for activity in protocol.activities}
    impossible = sorted(kind for kind in kinds if not find_kind(kind).is_for_players)
    if impossible:
        possible = list_kinds(lambda kind: kind.is_for_players)
        raise SimulationError(
            f"study {protocol.study.name!r} has {', '.join(impossible)}, which a language model "
            f"cannot play; use only {', '.join(possible)}"
        )
    if protocol.allocation.stratify_by:
        raise SimulationError(
            f"study {protocol.study.name!r} has strata, to which a language model cannot be assigned; remove them"
        )
    if protocol.model.modality != "picture":
        for world_id, options in {block.world: block.options for block in protocol.blocks}.items():
            with closing(World(world_id, options)) as world:
                world.reset(0)
                world.text()


def _find_cut_off(study_dir: Path, player: str) -> Iterator[Path | str]:
    """Yield what a stopped run can resume: this player's live files, and the codes of slots without a recorded plan."""
    for slot in read_enrolled(study_dir):
        folder = study_dir / slot.participant
        parts = list_log_files(folder, f"ses-*/*{PART_SUFFIX}")
        if any(is_being_recorded(part) for part in parts):
            continue
        try:
            yield from [part for part in parts if read_log(part).player == player]
        except LogError:  # the log ends before the plan, so no request was sent
            yield slot.participant
        else:
            if not parts and not list_log_files(folder, f"ses-*/*{LOG_SUFFIX}"):
                yield slot.participant


@contextmanager
def _hold_slots(data: Path) -> Iterator[None]:
    """Hold the lock under which one session at a time, in any process, chooses its slot and creates its live file."""
    with hold_lock(data / ".slots.lock"):
        yield


def play_participant(protocol: Protocol, data: Path, run: ModelRun) -> list[Path]:
    """Play the sessions of one model to the study's end; return their logs.

    A session that a killed or stopped run of this model left is resumed; if there is none, the next slot is taken.

    Args:
        protocol: the study.
        data: the models' data folder.
        run: the run to which the sessions belong.

    Raises:
        MinihumanError: as `simulate_models` does.
    """
    run.check()
    settings = RecorderSettings(group=run.group_commit)
    plan, path, reason = _play_first_session(protocol, data, run, settings)
    logs = [path] if path else []
    for session in range(plan.session + 1, len(protocol.sessions) + 1):
        if reason != "complete":
            break
        plan = plan_next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
        log = McapRecorder(data, plan, started_ns=time.time_ns(), settings=settings)
        path, reason = _play(protocol, data, plan, run, log)
        if path:
            logs.append(path)
    return logs


def _play_first_session(
    protocol: Protocol, data_folder: Path, run: ModelRun, settings: RecorderSettings
) -> tuple[SessionPlan, Path | None, str]:
    """Finish or resume the session that a killed or stopped run left, or play the first session of the next slot.

    Returns:
        The session's plan, its log and the reason why it ended.
    """
    leftover = None
    with _hold_slots(data_folder):
        unfinished_session = next(_find_cut_off(data_folder / protocol.study.name, run.name), None)
        if isinstance(unfinished_session, Path):
            ended = read_log(unfinished_session)
            if ended.end_reason != CUT_OFF:
                path = recover_log(unfinished_session).path
                record_log_end(path)
                return ended.plan, path, ended.end_reason
            leftover = resume_segment(unfinished_session)
            assert isinstance(leftover.events[0], SessionStarted)
            plan = leftover.events[0].plan
            log = McapRecorder(data_folder, plan, started_ns=leftover.started_ns, settings=settings, left=leftover)
        else:
            plan = plan_next_session(protocol, data_folder, participant=unfinished_session, prefix="model")
            log = McapRecorder(data_folder, plan, started_ns=time.time_ns(), settings=settings)
    return plan, *_play(protocol, data_folder, plan, run, log, leftover)


def _build_session(plan: SessionPlan, run: ModelRun, spec: ModelSpec) -> SessionMachine:
    """Build a new session, with facts about the model, the machine and the worlds for its log."""
    facts = {"player": run.name, **collect_machine_facts(), **collect_world_facts(list_world_ids(plan))}
    facts |= {"window": "model", "answer_rules": ANSWER_RULES}
    return SessionMachine(plan, World, facts, picture_px=find_picture_size(spec))


def _resume_session(
    leftover: LeftoverSegment, spec: ModelSpec, record: ConversationRecord, log: McapRecorder
) -> SessionMachine:
    """Rebuild a session by replaying its logged events, which also restores its conversation in the record."""

    def follow(session: SessionMachine, event: Event | None) -> None:
        if event is None or isinstance(event, ModelCall):
            record.follow(session, event)
        else:
            record.see_input(event)

    session, unwritten = resume_from_events(leftover.events, World, picture_px=find_picture_size(spec), follow=follow)
    log.begin(unwritten)
    return session


def _play(
    protocol: Protocol,
    data: Path,
    plan: SessionPlan,
    run: ModelRun,
    log: McapRecorder,
    leftover: LeftoverSegment | None = None,
) -> tuple[Path | None, str]:
    """Play one session, or the remainder of a leftover one; return its log and the reason why it ended.

    Raises:
        MinihumanError: if the model gives no answer, the run has to stop, or the world failed.
    """
    spec = decode_logged_protocol(plan.protocol_toml).model
    clock = VirtualClock()
    record = ConversationRecord(spec)
    recorder = ResumableRecorder(log)
    recorder.leave = True  # until the session runs, an error leaves its log to be resumed
    try:
        if leftover is None:
            session = _build_session(plan, run, spec)
        else:
            session = _resume_session(leftover, spec, record, log)
            clock.advance_to(max(event.t_ns for event in leftover.events))
        window = ModelWindow(session, clock, run.make_client(spec), spec, run, record, recorder)
        agent = make_agent_host(protocol, plan, data, patient=True)
    except BaseException:
        recorder.close()
        raise
    recorder.leave = False
    try:
        path = run_session(session, window, recorder, clock, agent=agent, finished=record_log_end)
    except SessionLeft as interruption:
        raise interruption.error from None
    finally:
        window.close()
    if session.failure is not None:
        raise describe_world_failure(session, path) from session.failure
    return path, session.end_reason


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
