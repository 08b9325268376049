"""A window that a language model controls, and a recorder that makes each call durable before it is sent."""

import time
from dataclasses import replace
from pathlib import Path

from minihuman.display.windows.window import VirtualClock, Window
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import ENTER_KEYS
from minihuman.experiment.machine.events import ModelCall
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, PointerPressed, ScreenShown, Stop, TextInput
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import BlankScreen, PageScreen, PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import WrappedRecorder
from minihuman.runtime.model_run import ModelRun, RunStoppedError
from minihuman.simulation.chat_client import ChatAnswer, ModelClient, ModelUnavailableError
from minihuman.simulation.model_conversation import (
    HOLD_MS,
    NS_PER_MS,
    WAIT,
    AnswerRule,
    ConversationRecord,
    Prompt,
    count_price,
    find_answer_rule,
)

READING_MS = 1_000.0  # the time for which a screen without a decision is shown
FRAME_NS = 16_666_667  # of a display of 60 Hz
MAX_USELESS_KEYS = 100  # in a row, without a step
MAX_SAME_QUESTION = 20  # in a row, how often a question is asked at most
RETRY_WAIT_S = 0.5  # before the first retry; doubled each time
MAX_RETRY_WAIT_S = 30.0


class ModelWindow(Window):
    """Asks a model which key to press, and presses it. Screens that need no decision are read in one second.

    Args:
        session: the model's session.
        clock: the session's clock; waiting advances it by the time that an answer took.
        client: asks the model.
        spec: the protocol's settings for models.
        run: counts the expenses.
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
        self._session = session
        self._clock = clock
        self._client = client
        self._spec = spec
        self._run = run
        self._record = record
        self._recorder = recorder
        self._screen: Screen = TextScreen("", "", "")
        self._waiting_screen: Screen | None = None  # the screen at which the model decided to wait
        self._attempt = 1
        self._n_useless_keys = 0
        self._last_step: tuple[int, int] | None = None  # episode and step at the last key
        self._last_question = ""
        self._n_times_asked = 0  # how often that question was asked in a row
        if record.call is not None:
            self._resume_after(record.call)

    def _resume_after(self, last_call: ModelCall) -> None:
        """Continue a resumed session after its last call; if the log has no answer to this call, record it as lost."""
        spec = self._spec
        if last_call.state == "answered":
            self._attempt = last_call.attempt + (1 if last_call.verdict == "invalid" else 0)
        elif last_call.state == "asked":
            price = count_price(spec, last_call.prompt_tokens, spec.max_tokens)
            self._record_call(replace(last_call, state="unknown", completion_tokens=spec.max_tokens, price=price))
            if spec.unknown == "end":
                self._end_session("a call's answer was lost")

    def show(self, screen: Screen) -> ScreenShown:
        """Show a screen to the model; it counts as displayed one frame later."""
        self._screen = screen
        self._record.conversation.see(screen)
        submit_ns = self._clock()
        self._clock.advance_to(submit_ns + FRAME_NS)
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Advance the clock to the next input and return it in a list, or to ``until_ns`` and return [].

        Raises:
            SessionLeft: if the model gives no answer, or the run has to stop.
        """
        if not any(isinstance(coming, KeyDown | PointerPressed | TextInput | Stop) for coming in self._record.coming):
            try:
                self._answer_screen()
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
        """Return the facts about the window."""
        return {"window": "model"}

    def close(self) -> None:
        """Close the connection to the model."""
        self._client.close()

    def _answer_screen(self) -> None:
        """Let the model answer the screen, or press the key that leads on from a screen without an answer."""
        rule = find_answer_rule(self._screen, self._session)
        if rule is not None:
            if self._waiting_screen is not self._screen:
                self._ask_for_answer(rule)
            return
        match self._screen:
            case BlankScreen() | PlayScreen():
                return
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self._press(missing[0])
            case PageScreen():
                self._press(ENTER_KEYS[0])
            case TextScreen() if self._session.next_tick_ns is None:  # otherwise a rest is running
                self._press(ENTER_KEYS[0])

    def _press(self, key: str) -> None:
        """Schedule the press and release of a key after the reading time."""
        down_ns = self._clock() + round(READING_MS * NS_PER_MS)
        self._record.add([KeyDown(down_ns, key, key), KeyUp(down_ns + round(HOLD_MS * NS_PER_MS), key, key)])

    def _ask_for_answer(self, rule: AnswerRule) -> None:
        """Ask the model to answer the screen; end the session if a limit is reached or no answer is valid."""
        reason = self._find_end_reason()
        if reason:
            self._end_session(reason)
            return
        call = self._ask(rule)
        if call.verdict == "valid":
            self._attempt = 1
            if call.reading == WAIT:
                self._waiting_screen = self._screen
            return
        self._attempt += 1
        if self._spec.invalid == "end" or self._attempt > self._spec.retries + 1:
            self._end_session("no valid answer")
        elif self._spec.invalid == "no_op" and rule.may_wait:
            self._waiting_screen = self._screen

    def _find_end_reason(self) -> str:
        """Return the reason for ending the session instead of asking again; "" if there is none."""
        reason = self._find_reached_limit()
        if reason:
            return reason
        if self._session.play is not None:
            return self._count_useless_key(self._session.play)
        return self._count_question()

    def _find_reached_limit(self) -> str:
        """Return which of the protocol's limits the session has reached; "" if none."""
        spec = self._spec
        spent = self._record.spent
        for limit, used, unit in (
            (spec.max_price, spent.price, spec.currency or "money"),
            (spec.max_session_tokens, spent.tokens, "tokens"),
            (spec.max_session_s, spent.latency_ms / 1_000, "seconds"),
        ):
            if limit and used >= limit:
                return f"the session's limit of {limit:g} {unit} is reached"
        return ""

    def _count_useless_key(self, play: RunningEpisode) -> str:
        """Count the last key if it led to no step; return why the session ends if there were too many, otherwise ""."""
        episode_and_step = (play.plan.episode, play.steps)
        if episode_and_step != self._last_step:
            self._n_useless_keys = 0
        elif self._attempt == 1:
            self._n_useless_keys += 1
        self._last_step = episode_and_step
        if self._n_useless_keys > MAX_USELESS_KEYS:
            return f"{MAX_USELESS_KEYS} keys in a row led to no step"
        return ""

    def _count_question(self) -> str:
        """Count how often the screen's question was asked; return why the session ends if too often, otherwise ""."""
        question = getattr(self._screen, "question", "")
        if question == self._last_question:
            self._n_times_asked += 1
        else:
            self._last_question = question
            self._n_times_asked = 1
        if question and self._n_times_asked > MAX_SAME_QUESTION:
            return f"a question was answered {MAX_SAME_QUESTION} times and not left"
        return ""

    def _end_session(self, reason: str) -> None:
        """Replace the session's pending inputs by one that ends the session as failed, for a reason."""
        self._record.coming = [Stop(self._clock(), "player_failed", reason)]

    def _ask(self, rule: AnswerRule) -> ModelCall:
        """Send the screen's prompt, with as many retries as the protocol allows, and return the answered call.

        Raises:
            ModelUnavailableError: if the model gives no answer.
            RunStoppedError: if the run has to stop.
        """
        prompt = self._record.conversation.build_prompt(self._screen, rule, self._session)
        for failures in range(self._spec.retries + 1):
            self._run.check()
            request = self._build_call(prompt, rule)
            self._record.rule = rule
            self._record_call(request)
            try:
                return self._read_answer(request, rule, self._client.ask(prompt))
            except ModelUnavailableError as error:
                self._record_call(replace(request, state="failed", prompt_tokens=0, error=error.reason))
                if failures == self._spec.retries or not error.temporary:
                    raise
            time.sleep(min(MAX_RETRY_WAIT_S, RETRY_WAIT_S * 2**failures))
        raise AssertionError("the last failure is raised")

    def _build_call(self, prompt: Prompt, rule: AnswerRule) -> ModelCall:
        """Return the record of a call that is about to be sent."""
        session = self._session
        spec = self._spec
        earlier_calls = 0
        if self._record.call is not None:
            earlier_calls = self._record.call.call
        steps = 0
        if session.play is not None:
            steps = session.play.steps
        return ModelCall(
            self._clock(),
            call=earlier_calls + 1,
            state="asked",
            episode=session.next_episode,
            step=steps,
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

    def _read_answer(self, request: ModelCall, rule: AnswerRule, answer: ChatAnswer) -> ModelCall:
        """Read and record the model's answer to a request; return the answered call."""
        reading = rule.read(answer.text)
        call = replace(
            request,
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
        self._record_call(call)
        return call

    def _record_call(self, call: ModelCall) -> None:
        """Record a call in the log and the conversation, and count its expenses once it is answered or has failed."""
        self._recorder.record(call)
        self._record.take(call)
        if call.state != "asked":
            self._run.count(call)


class SessionLeft(BaseException):
    """A session is left to be resumed. It is not an `Exception`, as the loop ends the session after one."""

    def __init__(self, error: MinihumanError) -> None:
        super().__init__(str(error))
        self.error = error


class ResumableRecorder(WrappedRecorder):
    """Leaves the live file unfinished when a run stops between two calls."""

    def __init__(self, log: McapRecorder) -> None:
        super().__init__(log)
        self._log = log
        self.leave = False

    def record(self, call: ModelCall) -> None:
        """Write a call; a request and everything before it is durable when this returns."""
        self._log.begin([call])
        if call.state == "asked":
            self._log.drain()

    def close(self) -> Path | None:
        """Finish the log and return its path; if it is to be resumed, leave it unfinished and return None."""
        if not self.leave:
            return super().close()
        self._log.leave()
        return None
