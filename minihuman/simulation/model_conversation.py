"""The prompts that show a language model a participant's screens, and the reading of its answers.

No network, clock or file is used. A model is shown the same screens as a person: a picture is the same drawing at the
protocol's size. A `Conversation` that is fed the same screens and answers composes the same prompts, so that a log
proves them.
"""

import base64
import hashlib
import json
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.questions.activity import QuestionsActivity
from minihuman.activities.questions.question import find_question_kind
from minihuman.display.drawing.screen import picture_size_px, repaint_screen
from minihuman.experiment.machine.events import Event, KeyPressed, ModelCall, PointerUsed, TextTyped
from minihuman.experiment.machine.inputs import (
    Input,
    KeyDown,
    KeyUp,
    PointerPressed,
    PointerReleased,
    TextInput,
)
from minihuman.experiment.machine.screens import (
    OptionList,
    PageScreen,
    PlayScreen,
    QuestionScreen,
    RatingMatrix,
    RatingScale,
    Screen,
    ShapeCanvas,
    Slider,
    TextField,
    TextScreen,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.log.observations import encode_png
from minihuman.simulation.screen_text import join_texts, list_observation, list_screen_texts

NS_PER_MS = 1_000_000
HOLD_MS = 90.0
TOKENS_PER_PICTURE = 1_500  # an estimate, for calls whose answer is lost
BYTES_PER_TOKEN = 3  # of text, an estimate as well
WAIT = "wait"
SKIP = "skip"
# The fact "answer_rules" of a session, by which its prompts are proved. Before 2, every question could be left out;
# before 3, a prompt repeated too few of the earlier screens until there were as many as `history` asks for.
ANSWER_RULES = "3"

RULES = (
    "You take part in a study in the place of a person, and are shown the screens that a person is shown. Each message "
    "ends with what can be answered. Put your answer alone on the last line, after 'Answer:'."
)
_ANSWER = re.compile(r"^[\s>*_`#-]*answer[\s*_`]*[:=]\s*(?P<answer>.*)$", re.IGNORECASE)
_NUMBERS = re.compile(r"\d+(?:\s*[,; ]\s*\d+)*")


@dataclass(frozen=True, slots=True)
class AnswerRule:
    """The answers that a screen accepts, in words and as values."""

    screen: str  # "play", "page" or "question"
    request: str  # the prompt's last line
    keys: tuple[str, ...] = ()
    named: tuple[tuple[str, str], ...] = ()  # an action's name on the screen, and its key
    buttons: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()  # of options, in the order numbered
    many: bool = False
    ordered: bool = False  # the order of the answer's numbers counts
    chosen: tuple[int, ...] = ()  # options that are chosen already
    typed: int = 0  # characters that are in the field already
    number: bool = False  # 0 to 100
    text: bool = False
    may_wait: bool = False
    may_skip: bool = False

    def read(self, answer: str) -> str | None:
        """Return a model's answer in normal form, such as "key 3"; None if it is not valid."""
        lines = [line for line in answer.strip().splitlines() if line.strip()]
        marked = [match["answer"] for match in map(_ANSWER.match, lines) if match]
        if marked:
            answer_line = marked[-1]
        elif self.text and lines:
            answer_line = lines[-1]
        else:
            answer_line = answer
        words = answer_line.strip().strip("`'\"<>*").strip()
        word = words.rstrip(".").strip().lower()
        if self.keys:
            return self._read_key(word)
        if self.buttons:
            return self._read_button(word)
        if word == SKIP and self.may_skip:
            return SKIP
        if self.targets:
            return self._read_options(word)
        if self.number:
            return _read_slider(word)
        typed = "".join(letter for letter in words if letter.isprintable())
        if self.text and typed:
            return f"text {typed}"
        return None

    def _read_key(self, word: str) -> str | None:
        """Return an answer such as "key 3" or the word for waiting; None if it is neither."""
        key = dict(self.named).get(word, word.removeprefix("key ").strip())
        if key in self.keys:
            return f"key {key}"
        if word == WAIT and self.may_wait:
            return WAIT
        return None

    def _read_button(self, word: str) -> str | None:
        """Return an answer such as "button decline"; None if it is not a button."""
        button = word.replace(" ", "_")
        if button in self.buttons:
            return f"button {button}"
        return None

    def _read_options(self, word: str) -> str | None:
        """Return an answer such as "choose 1 3"; None if it is not the numbers of options, or too many of them."""
        if not _NUMBERS.fullmatch(word):
            return None
        numbers = [int(number) for number in re.findall(r"\d+", word)]
        if not self.many and len(numbers) != 1:
            return None
        if not all(1 <= number <= len(self.targets) for number in numbers):
            return None
        return f"choose {' '.join(map(str, numbers))}"


def _read_slider(word: str) -> str | None:
    """Return an answer such as "slide 50.0"; None if it is not a number from 0 to 100."""
    try:
        number = float(word)
    except ValueError:
        return None
    if 0 <= number <= 100:
        return f"slide {number}"
    return None


def find_answer_rule(screen: Screen, session: SessionMachine) -> AnswerRule | None:
    """Return the answers that a screen accepts; None if it is only read or ends by itself."""
    match screen:
        case PlayScreen() if session.play is not None:
            named = tuple((action.lower(), key) for key, action in screen.legend)
            may_wait = session.part.real_time
            keys = session.plan.key_pool
            or_wait = ""
            if may_wait:
                or_wait = f", or '{WAIT}' to press none"
            request = f"Answer with one key of: {' '.join(keys)}{or_wait}."
            return AnswerRule("play", request, keys=keys, named=named, may_wait=may_wait)
        case PageScreen(buttons=buttons) if screen.page == screen.pages:
            labels = {button.name: button.label for button in buttons if button.name != "back"}
            if "decline" in labels:
                request = " or ".join(f"'{name}' ({label})" for name, label in labels.items())
                return AnswerRule("page", f"Answer with {request}.", buttons=tuple(labels))
        case QuestionScreen(item=item) if isinstance(part := session.part, QuestionsActivity):
            rule = _find_question_rule(item)
            if find_question_kind(part.draft.question.kind).answer_type == "order":
                request = "Answer with the numbers of all, in your order, the first first."
                rule = replace(rule, request=request, many=True, ordered=True)
            if part.draft.model_request:
                rule = replace(rule, request=part.draft.model_request)
            if _get_answer_rules_version(session) >= 2 and part.draft.question.required:
                return rule
            return replace(rule, request=f"{rule.request} '{SKIP}' leaves it out.", may_skip=True)
    return None


def _get_answer_rules_version(session: SessionMachine) -> int:
    """Return the version of the rules by which a session's prompts are made."""
    return int(session.part.context.facts.get("answer_rules", "1"))


def _name_options(count: int) -> tuple[str, ...]:
    """Return the names of the click targets of a question's first ``count`` options."""
    return tuple(f"option:{number}" for number in range(count))


def _find_question_rule(item: Any) -> AnswerRule:
    """Return the answers that a question accepts, by its widget."""
    match item:
        case OptionList(options=options, many=many, chosen=chosen):
            request = "Answer with one option's number."
            if many:
                request = "Answer with the numbers of all that apply."
            return AnswerRule("question", request, targets=_name_options(len(options)), many=many, chosen=chosen)
        case RatingScale(points=points):
            request = f"Answer with one number from 1 to {len(points)}."
            return AnswerRule("question", request, targets=_name_options(len(points)))
        case RatingMatrix(rows=rows, points=points):
            request = "Answer with the numbers of one point for each statement."
            return AnswerRule("question", request, targets=_name_options(len(rows) * len(points)), many=True)
        case ShapeCanvas(shapes=shapes):
            answers = [shape for shape in shapes if shape.target]
            targets = tuple(shape.target for shape in answers)
            chosen = tuple(number for number, shape in enumerate(answers) if shape.chosen)
            return AnswerRule("question", "Answer with one shape's number.", targets=targets, chosen=chosen)
        case Slider():
            return AnswerRule("question", "Answer with a number from 0 (left end) to 100 (right end).", number=True)
    typed = 0
    if isinstance(item, TextField):
        typed = len(item.text)
    return AnswerRule("question", "Answer with a text of one line.", text=True, typed=typed)


def list_inputs(reading: str, rule: AnswerRule, t_ns: int) -> list[Input]:
    """Return the inputs that carry out an answer, in order of time; each leaves one event in the log.

    Args:
        reading: the answer in normal form, from ``AnswerRule.read``.
        rule: the answers that the screen accepts.
        t_ns: the time of the first input.
    """
    action, _, argument = reading.partition(" ")
    match action:
        case "key":
            up_ns = t_ns + round(HOLD_MS * NS_PER_MS)
            return [KeyDown(t_ns, argument, argument), KeyUp(up_ns, argument, argument)]
        case "button":
            return _click(t_ns, argument)
        case "choose":
            clicks = [(rule.targets[number], _MIDDLE) for number in _list_chosen(argument, rule)]
        case "slide":
            clicks = [("slider", float(argument) / 100)]
        case "text":
            clicks = []
        case _:
            if reading == WAIT:
                return []
            return _click(t_ns, "go_on")  # skip
    inputs: list[Input] = []
    for _ in range(rule.typed):
        inputs += [KeyDown(t_ns, "backspace"), KeyUp(t_ns, "backspace")]
    if action == "text":
        inputs.append(TextInput(t_ns, argument))
    step_ns = round(2 * HOLD_MS * NS_PER_MS)
    for number, (target, along) in enumerate(clicks):
        inputs += _click(t_ns + number * step_ns, target, along)
    n_steps = max(1, len(clicks))
    return inputs + _click(t_ns + n_steps * step_ns, "go_on")


def _list_chosen(argument: str, rule: AnswerRule) -> list[int]:
    """Return the indices, from 0, of the options to click on so that those of ``argument``, "1 3", are then chosen."""
    indices = [int(number) - 1 for number in argument.split()]
    if rule.ordered:  # earlier choices are undone first, the last one first
        return [*reversed(rule.chosen), *indices]
    if rule.many:
        return sorted({*indices} ^ {*rule.chosen})  # a click on a chosen option takes it back
    return sorted({*indices})


_MIDDLE = 0.5  # of the screen, or of a target


def _click(t_ns: int, target: str, along: float = _MIDDLE) -> list[Input]:
    """Return a press and a release on a target, at a position along it from 0 to 1."""
    up_ns = t_ns + round(HOLD_MS * NS_PER_MS)
    return [
        PointerPressed(t_ns, _MIDDLE, _MIDDLE, target, along),
        PointerReleased(up_ns, _MIDDLE, _MIDDLE, target, along),
    ]


@dataclass(frozen=True, slots=True)
class Prompt:
    """The messages of a request, with the digests and token counts that the log records."""

    messages: list[dict[str, Any]]
    sha256: str
    picture_sha256: str
    tokens: int  # estimated
    text: str  # the screen in words, and what it takes
    read: str  # the pages so far
    rule: AnswerRule
    picture: bytes | None  # the screen as PNG
    observation: Any  # of a grid world, as lists; None unless the protocol sends text


class Conversation:
    """A record of what a model was shown and answered, which composes the next prompt.

    Args:
        spec: the protocol's settings of the model.
    """

    def __init__(self, spec: ModelSpec) -> None:
        self._spec = spec
        self._pages: list[str] = []  # pages, which stay in every prompt
        self._recent_texts: list[str] = []  # texts since the last answer
        self._exchanges: list[tuple[str, str]] = []  # screen in words, and the answer to it
        self._question = ""
        self._last_screen: Screen | None = None
        # The last drawing; only changes are drawn.
        self._canvas = np.zeros((*spec.size_px[::-1], 3), np.uint8)
        self._drawn_screen: Screen | None = None

    def see(self, screen: Screen) -> None:
        """Record a screen that is shown; showing the same screen again changes nothing."""
        if screen is self._last_screen:
            return
        self._last_screen = screen
        match screen:
            case PageScreen():
                text = join_texts(screen.title, screen.body)
                if text not in self._pages:
                    self._pages.append(text)
            case TextScreen(keys=()):
                self._note(join_texts(screen.title, screen.body))
            case PlayScreen() if screen.mark:
                outcome = {"good": "success", "bad": "failure", "neutral": "no success"}[screen.mark]
                self._note(join_texts(f"The episode ended: {outcome}.", screen.score_text))

    def _note(self, text: str) -> None:
        """Add a text to those since the last answer, unless it is empty or a repetition."""
        if text and self._recent_texts[-1:] != [text]:
            self._recent_texts.append(text)

    def build_prompt(self, screen: Screen, rule: AnswerRule, session: SessionMachine) -> Prompt:
        """Build the prompt for a screen that needs an answer."""
        description = "\n\n".join(list_screen_texts(screen, session, self._spec))
        self._question = "\n\n".join(filter(None, [*self._recent_texts, description]))
        text = f"{self._question}\n\n{rule.request}"
        messages: list[dict[str, Any]] = [{"role": "system", "content": join_texts(RULES, *self._pages)}]
        for earlier_text, answer in self._list_history(_get_answer_rules_version(session)):
            messages += [{"role": "user", "content": earlier_text}, {"role": "assistant", "content": answer}]
        picture = self._draw(screen)
        text_messages = [*messages, {"role": "user", "content": text}]
        png = None
        content: Any = text
        digest = ""
        if picture is not None:
            png = encode_png(picture)
            content = [{"type": "text", "text": text}, _make_image_part(png)]
            digest = hashlib.sha256(str(picture.shape).encode() + picture.tobytes()).hexdigest()
        sha256 = hashlib.sha256(json.dumps([text_messages, digest], ensure_ascii=False).encode()).hexdigest()
        n_bytes = sum(len(message["content"].encode()) for message in text_messages)
        tokens = n_bytes // BYTES_PER_TOKEN
        if picture is not None:
            tokens += TOKENS_PER_PICTURE
        sent = [*messages, {"role": "user", "content": content}]
        if self._spec.modality != "picture":
            observation = list_observation(session)
        else:
            observation = None
        return Prompt(sent, sha256, digest, tokens, text, join_texts(*self._pages), rule, png, observation)

    def _list_history(self, answer_rules: int) -> list[tuple[str, str]]:
        """Return the (screen, answer) pairs that a prompt repeats: the last ones, as many as `history` asks for."""
        n_repeated = self._spec.history
        if n_repeated == 0:
            return []
        begin = len(self._exchanges) - n_repeated
        if answer_rules >= 3:  # earlier rules counted a negative begin from the end, and logs must replay
            begin = max(0, begin)
        return self._exchanges[begin:]

    def _draw(self, screen: Screen) -> NDArray[np.uint8] | None:
        """Draw the whole screen as uint8[height, width, 3]; return None if the prompt needs no picture."""
        if getattr(screen, "picture", None) is None or self._spec.modality == "text":
            return None
        repaint_screen(self._canvas, self._drawn_screen, screen)
        self._drawn_screen = screen
        return self._canvas

    def take(self, call: ModelCall) -> None:
        """Record a call's answer, whether or not it is valid."""
        self._exchanges.append((self._question, call.answer))
        self._recent_texts = []
        if call.verdict != "valid" and self._spec.invalid == "retry":
            self._recent_texts.append("That answer was not valid.")


def _make_image_part(png: bytes) -> dict[str, Any]:
    return {"type": "image_url", "image_url": {"url": f"data:image/png;base64,{base64.b64encode(png).decode()}"}}


@dataclass(frozen=True, slots=True)
class SpentTotals:
    """The cost of a session's model calls so far; a call whose cost is unknown counts at its maximum."""

    calls: int = 0
    tokens: int = 0
    price: float = 0.0
    latency_ms: float = 0.0

    def add(self, call: ModelCall) -> "SpentTotals":
        """Return the totals with a call added; a call without a result yet changes nothing."""
        if call.state == "asked":
            return self
        return SpentTotals(
            self.calls + 1,
            self.tokens + call.prompt_tokens + call.completion_tokens,
            self.price + call.price,
            self.latency_ms + call.latency_ms,
        )


def find_picture_size(spec: ModelSpec) -> tuple[int, int] | None:
    """Return the size of the largest world picture on a model's screens; None if the model receives text only."""
    if spec.modality == "text":
        return None
    return picture_size_px(spec.size_px)


def count_price(spec: ModelSpec, prompt_tokens: int, completion_tokens: int) -> float:
    """Return the price of tokens by the protocol's prices per million tokens, in the protocol's currency."""
    return (prompt_tokens * spec.price_prompt + completion_tokens * spec.price_completion) / 1_000_000


class ConversationRecord:
    """A conversation and its latest call, followed through a log or a running session."""

    def __init__(self, spec: ModelSpec) -> None:
        self.conversation = Conversation(spec)
        self.spent = SpentTotals()
        self.call: ModelCall | None = None  # the latest
        self.rule: AnswerRule | None = None  # of the screen that it was about
        self.coming: list[Input] = []  # what answers stand for and has not happened yet, in order of time

    def follow(self, session: SessionMachine, call: ModelCall | None) -> str:
        """Follow a replay by a logged call, or by the session's screen if ``call`` is None.

        Return how the call's prompt, or the reading of its answer, differs from that in the log; "" if it does not.
        """
        if call is None:
            self.conversation.see(session.screen)
            return ""
        difference = ""
        if call.state == "asked":
            self.rule = find_answer_rule(session.screen, session)
            if self.rule is None:
                return f"call {call.call}: the screen asks for no answer"
            prompt = self.conversation.build_prompt(session.screen, self.rule, session)
            difference = _compare_prompt(prompt, call)
        elif call.state == "answered" and self.rule is not None:
            reading = self.rule.read(call.answer)
            verdict = "valid" if reading else "invalid"
            if (reading or "", verdict) != (call.reading, call.verdict):
                difference = f"call {call.call}: the answer is read as {call.reading!r} in the log, now {reading!r}"
        self.take(call)
        return difference

    def take(self, call: ModelCall) -> None:
        """Record a call, its cost and its answer; schedule the inputs that a valid answer stands for."""
        self.call = call
        self.spent = self.spent.add(call)
        if call.state == "answered":
            self.conversation.take(call)
        if call.verdict == "valid" and self.rule is not None:
            self.add(list_inputs(call.reading, self.rule, call.t_ns + round(call.latency_ms * NS_PER_MS)))

    def add(self, inputs: list[Input]) -> None:
        """Add pending inputs; they may still include the key release of the last answer."""
        self.coming = sorted([*self.coming, *inputs], key=lambda happened: happened.t_ns)

    def see_input(self, event: Event) -> None:
        """Follow a replay by removing the pending input that caused an event."""
        for number, happened in enumerate(self.coming):
            if _leaves_event(happened, event):
                del self.coming[number]
                return


def _compare_prompt(prompt: Prompt, call: ModelCall) -> str:
    """Return how a prompt differs from the logged call that sent it; "" if it does not."""
    if prompt.picture_sha256 != call.picture_sha256:
        return f"call {call.call}: the picture sent has digest {call.picture_sha256[:16]}, here not"
    if prompt.sha256 != call.prompt_sha256:
        return f"call {call.call}: the prompt sent has digest {call.prompt_sha256[:16]}, here not"
    return ""


def _leaves_event(happened: Input, event: Event) -> bool:
    """Return whether an event in the log records an input of the model."""
    match happened, event:
        case (KeyDown() | KeyUp(), KeyPressed()):
            is_down = isinstance(happened, KeyDown)
            return happened.key == event.key and is_down is event.down
        case (PointerPressed() | PointerReleased(), PointerUsed(what="pressed" | "released")):
            what = "pressed" if isinstance(happened, PointerPressed) else "released"
            return happened.target == event.target and what == event.what
    return isinstance(happened, TextInput) and isinstance(event, TextTyped)
