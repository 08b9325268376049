"""Sessions with a language model in the participant's place: several side by side, resumed after any cut.

Every request is durable before it is sent. Its answer and what came of it become durable in this order, at the latest
with the session's next request: by one fsync. A live file that a killed program left is resumed at the same call, so
that no stored answer is asked for again.
"""

import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.enrolment_log import require_free_slots
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock, Window
from minihuman.errors import LogError, MinihumanError, SimulationError
from minihuman.experiment.machine.activity import ENTER_KEYS
from minihuman.experiment.machine.events import (
    Event,
    ModelCall,
    SessionStarted,
)
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, PointerPressed, ScreenShown, Stop, TextInput
from minihuman.experiment.machine.screens import BlankScreen, PageScreen, PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.experiment.replay import resume_from_events
from minihuman.log.model.session_log import CUT_OFF
from minihuman.log.paths import LOG_SUFFIX, MODELS_FOLDER, PART_SUFFIX
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import GroupCommit, RecorderSettings
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import LeftoverSegment, McapRecorder, resume_segment
from minihuman.log.record.recorder import WrappedRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.team_host import require_one_process
from minihuman.simulation.chat_client import ChatAnswer, ChatClient, ModelClient, ModelUnavailableError
from minihuman.simulation.model_conversation import (
    ANSWER_RULES,
    HOLD_MS,
    NS_PER_MS,
    WAIT,
    AnswerRule,
    ConversationRecord,
    SpentTotals,
    count_price,
    find_answer_rule,
    find_picture_size,
)
from minihuman.storage.locks import hold_lock
from minihuman.worlds.adapters.world import World

PLAYER_PREFIX = "model:"
READING_MS = 1_000.0
FRAME_NS = 16_666_667
MAX_USELESS_KEYS = 100  # in a row, without a step
MAX_SAME_QUESTION = 20
RETRY_WAIT_S = 0.5  # doubled each time, 30 s at most
_PLAYABLE = ("play", "team", "page", "questions", "keyboard_check")


class RunStoppedError(MinihumanError, RuntimeError):
    """The run is over before its sessions are: they are resumed by the same command."""


@dataclass(slots=True)
class ModelRun:
    """What the sessions of one run share: what they have spent, its limits, and whether it is to stop."""

    name: str  # "model:NAME", or "http:NAME" of a program
    make_client: Callable[[ModelSpec], ModelClient]
    max_price: float = 0.0
    changed: Callable[[SpentTotals], object] = lambda _: None
    spent: SpentTotals = field(default_factory=SpentTotals)
    stopped: str = ""  # why
    lock: threading.Lock = field(default_factory=threading.Lock)
    # one sync for all calls in flight: none of them waits for a picture, and each takes longer than a sync
    group_commit: GroupCommit = field(default_factory=lambda: GroupCommit(max_single_syncs=1))

    @classmethod
    def of_model(cls, player: str, **settings: Any) -> "ModelRun":
        """The run of a language model, "model:NAME"."""
        name = player.removeprefix(PLAYER_PREFIX)

        def make_client(spec: ModelSpec) -> ChatClient:
            known = {"temperature": spec.temperature, "max_tokens": spec.max_tokens}
            settings: dict[str, float] = {one: known[one.replace("_completion", "")] for one in spec.request_fields}
            return ChatClient(name, settings=settings, timeout_s=spec.timeout_s)

        return cls(player, make_client, **settings)

    def check(self) -> None:
        """Refuse another request.

        Raises:
            RunStoppedError: if the run is to stop.
        """
        if self.max_price and self.spent.price >= self.max_price:
            self.stop(f"the run's limit of {self.max_price:g} is reached")
        if self.stopped:
            raise RunStoppedError(f"{self.stopped}; run the same command again to resume with the next call")

    def stop(self, why: str) -> None:
        """Let no further request begin."""
        with self.lock:
            self.stopped = self.stopped or why

    def count(self, call: ModelCall) -> None:
        """Count a call's end."""
        with self.lock:
            self.spent = self.spent.add(call)
        self.changed(self.spent)


class ModelWindow(Window):
    """Asks a model what to press, and presses it. It reads what takes no decision in a second.

    Args:
        session: the session it sits in.
        clock: the session's; waiting moves it, by as much as an answer took.
        client: asks the model.
        spec: the protocol's settings.
        run: counts what is spent.
        record: the conversation so far.
        recorder: makes a call's events durable.
    """

    def __init__(
        self,
        session: SessionMachine,
        clock: VirtualClock,
        client: ModelClient,
        spec: ModelSpec,
        run: ModelRun,
        record: ConversationRecord,
        recorder: "ResumableRecorder",
    ) -> None:
        self._session, self._clock, self._client = session, clock, client
        self._spec, self._run, self._record, self._recorder = spec, run, record, recorder
        self._screen: Screen = TextScreen("", "", "")
        self._waited: Screen | None = None  # the screen for which the answer was to wait
        self._attempt = 1
        self._useless = 0
        self._step: tuple[int, int] | None = None  # episode and step at the last key
        self._question: tuple[str, int] = ("", 0)  # the last one, and how often it was asked in a row
        last = record.call
        if last is not None and last.state == "answered":  # of a program that was killed
            self._attempt = last.attempt + (last.verdict == "invalid")
        elif last is not None and last.state == "asked":
            price = count_price(spec, last.prompt_tokens, spec.max_tokens)
            self._take(replace(last, state="unknown", completion_tokens=spec.max_tokens, price=price))
            if spec.unknown == "end":
                self._stop("a call's answer was lost")

    def show(self, screen: Screen) -> ScreenShown:
        """Look at a screen; it is there one frame later."""
        self._screen = screen
        self._record.conversation.see(screen)
        submit_ns = self._clock()
        self._clock.advance_to(submit_ns + FRAME_NS)
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Move the clock to the next input, or to ``until_ns``.

        Raises:
            SessionLeft: if the model gives no answer, or the run is to stop.
        """
        if not any(isinstance(one, KeyDown | PointerPressed | TextInput | Stop) for one in self._record.coming):
            try:
                self._think()
            except (ModelUnavailableError, RunStoppedError) as error:
                self._recorder.leave = True
                raise SessionLeft(error) from error
        coming = self._record.coming
        if not coming or (until_ns is not None and until_ns < coming[0].t_ns):
            assert until_ns is not None, "neither an input nor a deadline: this would wait for ever"
            self._clock.advance_to(until_ns)
            return []
        happened = coming.pop(0)
        self._clock.advance_to(happened.t_ns)
        return [happened]

    def facts(self) -> dict[str, str]:
        """What it is."""
        return {"window": "model"}

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def _think(self) -> None:
        rule = find_answer_rule(self._screen, self._session)
        if rule is not None:
            if self._waited is not self._screen:
                self._decide(rule)
            return
        match self._screen:
            case BlankScreen() | PlayScreen():
                return
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self._press(missing[0])
            case PageScreen():
                self._press(ENTER_KEYS[0])
            case TextScreen() if self._session.next_tick_ns is None:  # else a rest is running
                self._press(ENTER_KEYS[0])

    def _press(self, key: str) -> None:
        down_ns = self._clock() + round(READING_MS * NS_PER_MS)
        self._record.add([KeyDown(down_ns, key, key), KeyUp(down_ns + round(HOLD_MS * NS_PER_MS), key, key)])

    def _decide(self, rule: AnswerRule) -> None:
        if reason := self._find_end(rule):
            self._stop(reason)
            return
        call = self._ask(rule)
        if call.verdict == "valid":
            self._attempt = 1
            if call.reading == WAIT:
                self._waited = self._screen
            return
        self._attempt += 1
        if self._spec.invalid == "end" or self._attempt > self._spec.retries + 1:
            self._stop("no valid answer")
        elif self._spec.invalid == "no_op" and rule.may_wait:
            self._waited = self._screen

    def _find_end(self, rule: AnswerRule) -> str:
        """Why no further answer is asked for, "" for no reason."""
        spec, spent, session = self._spec, self._record.spent, self._session
        for limit, used, unit in (
            (spec.max_price, spent.price, spec.currency or "money"),
            (spec.max_session_tokens, spent.tokens, "tokens"),
            (spec.max_session_s, spent.latency_ms / 1_000, "seconds"),
        ):
            if limit and used >= limit:
                return f"the session's limit of {limit:g} {unit} is reached"
        if session.play is not None:
            now = session.play.plan.episode, session.play.steps
            self._useless = (self._useless + (self._attempt == 1)) if now == self._step else 0
            self._step = now
            return f"{MAX_USELESS_KEYS} keys in a row led to no step" if self._useless > MAX_USELESS_KEYS else ""
        question = getattr(self._screen, "question", "")
        self._question = (question, self._question[1] + 1 if question == self._question[0] else 1)
        return (
            f"a question was answered {MAX_SAME_QUESTION} times and not left"
            if question and self._question[1] > MAX_SAME_QUESTION
            else ""
        )

    def _stop(self, reason: str) -> None:
        self._record.coming = [Stop(self._clock(), "player_failed", reason)]

    def _ask(self, rule: AnswerRule) -> ModelCall:
        """Ask until there is an answer, as often as the protocol says.

        Raises:
            ModelUnavailableError: if there is none.
            RunStoppedError: if the run is to stop.
        """
        session, record, spec = self._session, self._record, self._spec
        prompt = record.conversation.build_prompt(self._screen, rule, session)
        for failures in range(spec.retries + 1):
            self._run.check()
            asked = ModelCall(
                self._clock(),
                call=1 + (0 if record.call is None else record.call.call),
                state="asked",
                episode=session.next_episode,
                step=0 if session.play is None else session.play.steps,
                screen=rule.screen,
                attempt=self._attempt,
                prompt_sha256=prompt.sha256,
                picture_sha256=prompt.picture_sha256,
                provider=spec.provider,
                model=self._client.model,
                temperature=spec.temperature,
                max_tokens=spec.max_tokens,
                prompt_tokens=prompt.tokens,
            )
            record.rule = rule
            self._take(asked)
            try:
                return self._read(asked, rule, self._client.ask(prompt))
            except ModelUnavailableError as error:
                self._take(replace(asked, state="failed", prompt_tokens=0, error=error.reason))
                if failures == spec.retries or not error.temporary:
                    raise
            time.sleep(min(30.0, RETRY_WAIT_S * 2**failures))
        raise AssertionError("the last failure is raised")

    def _read(self, asked: ModelCall, rule: AnswerRule, answer: ChatAnswer) -> ModelCall:
        reading = rule.read(answer.text)
        call = replace(
            asked,
            state="answered",
            model=answer.model,
            prompt_tokens=answer.prompt_tokens,
            completion_tokens=answer.completion_tokens,
            price=count_price(self._spec, answer.prompt_tokens, answer.completion_tokens),
            latency_ms=answer.latency_ms,
            answer=answer.text,
            reasoning=answer.reasoning,
            finish_reason=answer.finish_reason,
            verdict="valid" if reading else "invalid",
            reading=reading or "",
        )
        self._take(call)
        return call

    def _take(self, call: ModelCall) -> None:
        self._recorder.record(call)
        self._record.take(call)
        if call.state != "asked":
            self._run.count(call)


class SessionLeft(BaseException):
    """A session is left where it is, to be resumed: no exception, or the loop would end it in its log."""

    def __init__(self, error: MinihumanError) -> None:
        super().__init__(str(error))
        self.error = error


class ResumableRecorder(WrappedRecorder):
    """Leaves the live file as it is when a run stops between two calls."""

    def __init__(self, log: McapRecorder) -> None:
        super().__init__(log)
        self._log = log
        self.leave = False

    def record(self, call: ModelCall) -> None:
        """Write a call down; a request is durable then, and all that came before it."""
        self._log.begin([call])
        if call.state == "asked":
            self._log.drain()

    def close(self) -> Path | None:
        """Finish the log, or leave it to be resumed."""
        if not self.leave:
            return super().close()
        self._log.leave()
        return None


def simulate_models(
    protocol: Protocol, data: Path, *, participants: int, parallel: int, run: ModelRun
) -> Iterator[Path]:
    """Play sessions with a model, ``parallel`` at a time: first those that were cut off, then new ones; yield the logs.

    The models' study lies in the folder ``models`` of the data folder: a model has the slot, the keys and the seeds of
    the participant with its number, and is in no count of people.

    Raises:
        AllocationError: if there are too few free slots, before any session.
        ModelUnavailableError: if the model gives no answer; its sessions are resumed by the same call.
        RunStoppedError: if a limit of the run is reached.
        SimulationError: if the study has parts that a model cannot take, or strata.
    """
    require_playable(protocol)
    data = data / MODELS_FOLDER
    study_dir = data / protocol.study.name
    require_free_slots(protocol, study_dir, participants - len(list(_find_cut_off(study_dir, run.name))))
    run.make_client(protocol.model).close()  # an address that is none must not cost a slot
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
            run.stop("another session failed" if isinstance(error, Exception) else "the run was interrupted")
            raise


def _yield_done(waiting: set[Future[list[Path]]]) -> Generator[Path, None, set[Future[list[Path]]]]:
    """Yield the logs of sessions that are done; return the others."""
    done, left = wait(waiting, return_when=FIRST_COMPLETED)
    for one in done:
        yield from one.result()
    return left


def require_playable(protocol: Protocol) -> None:
    """Refuse a study with parts that a model cannot take.

    Raises:
        SimulationError: if there is one, if groups are drawn after an answer, or if a world cannot be put into words.
    """
    require_one_process(protocol, "with a language model in a seat; give the other seats to agents")
    kinds = {block.kind for block in protocol.blocks} | {one.kind for one in protocol.activities}
    if kinds - {*_PLAYABLE}:
        raise SimulationError(
            f"study {protocol.study.name!r} has {', '.join(sorted(kinds - {*_PLAYABLE}))}, which a language model "
            f"cannot play; use only {', '.join(_PLAYABLE)}"
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
    """What a killed or stopped run left: live files of this model, and codes of slots whose session has no plan yet."""
    for slot in read_enrolled(study_dir):
        folder = study_dir / slot.participant
        parts = sorted(folder.glob(f"ses-*/*{PART_SUFFIX}"))
        if any(is_being_recorded(part) for part in parts):
            continue
        try:
            yield from [part for part in parts if read_log(part).player == player]
        except LogError:  # nothing was asked before the plan was written
            yield slot.participant
        else:
            yield from [] if parts or list(folder.glob(f"ses-*/*{LOG_SUFFIX}")) else [slot.participant]


@contextmanager
def _hold_slots(data: Path) -> Iterator[None]:
    """Let one session at a time, of all threads and processes, choose its slot and make its live file."""
    with hold_lock(data / ".slots.lock"):
        yield


def play_participant(protocol: Protocol, data: Path, run: ModelRun) -> list[Path]:
    """Play the sessions of one model to the study's end; return their logs.

    It resumes a session that a killed or stopped run of this model left, and takes the next slot where there is none.

    Args:
        protocol: the study.
        data: the models' data folder.
        run: whose sessions these are.

    Raises:
        MinihumanError: as `simulate_models`.
    """
    run.check()
    settings, left = RecorderSettings(group=run.group_commit), None
    log: McapRecorder | None = None
    path: Path | None
    with _hold_slots(data):
        begun = next(_find_cut_off(data / protocol.study.name, run.name), None)
        if isinstance(begun, Path) and (ended := read_log(begun)).end_reason != CUT_OFF:
            finished = recover_log(begun).path
            record_log_end(finished)
            path, plan, reason = finished, ended.plan, ended.end_reason
        elif isinstance(begun, Path):
            left = resume_segment(begun)
            assert isinstance(left.events[0], SessionStarted)
            plan = left.events[0].plan
            log = McapRecorder(data, plan, started_ns=left.started_ns, settings=settings, left=left)
        else:
            plan = plan_next_session(protocol, data, participant=begun, prefix="model")
            log = McapRecorder(data, plan, started_ns=time.time_ns(), settings=settings)
    if log is not None:
        path, reason = _play(protocol, data, plan, run, log, left)
    logs = [path] if path else []
    for session in range(plan.session + 1, len(protocol.sessions) + 1):
        if reason != "complete":
            break
        plan = plan_next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
        log = McapRecorder(data, plan, started_ns=time.time_ns(), settings=settings)
        path, reason = _play(protocol, data, plan, run, log)
        logs += [path] if path else []
    return logs


def _play(
    protocol: Protocol,
    data: Path,
    plan: SessionPlan,
    run: ModelRun,
    log: McapRecorder,
    left: LeftoverSegment | None = None,
) -> tuple[Path | None, str]:
    """Play one session, or the rest of one; return its log and why it ended."""
    spec = decode_logged_protocol(plan.protocol_toml).model
    clock, record, recorder = VirtualClock(), ConversationRecord(spec), ResumableRecorder(log)
    recorder.leave = True  # until it runs, an error leaves it to be resumed
    try:
        if left is None:
            facts = {"player": run.name, **collect_machine_facts(), **collect_world_facts(list_world_ids(plan))}
            facts |= {"window": "model", "answer_rules": ANSWER_RULES}
            session = SessionMachine(plan, World, facts, picture_px=find_picture_size(spec))
        else:

            def follow(session: SessionMachine, event: Event | None) -> None:
                if event is None or isinstance(event, ModelCall):
                    record.follow(session, event)
                else:
                    record.see_input(event)

            picture_px = find_picture_size(spec)
            session, unwritten = resume_from_events(left.events, World, picture_px=picture_px, follow=follow)
            clock.advance_to(max(event.t_ns for event in left.events))
            log.begin(unwritten)
        window = ModelWindow(session, clock, run.make_client(spec), spec, run, record, recorder)
        agent = make_agent_host(protocol, plan, data, patient=True)
    except BaseException:
        recorder.close()
        raise
    recorder.leave = False
    try:
        path = run_session(session, window, recorder, clock, agent=agent, finished=record_log_end)
    except SessionLeft as left_at:
        raise left_at.error from None
    finally:
        window.close()
    if session.failure is not None:
        raise session.failure
    return path, session.end_reason
