"""Questions: one after the other, answered by keys, text and pointer; some have a right answer, and tries."""

from typing import Literal

import msgspec

from minihuman.study import texts
from minihuman.study.activities.drafts import Draft, Question, Value, draft_of, is_right
from minihuman.study.activities.port import Activity, Ended, Kind
from minihuman.study.events import AnswerChanged, Answered, Noted
from minihuman.study.inputs import Input, KeyDown, PointerMoved, PointerPressed, Shown, Typed
from minihuman.study.phases import Phase
from minihuman.study.screens import QuestionScreen, TextScreen
from minihuman.study.stage import ENTER


class QuestionsPlan(msgspec.Struct, frozen=True):
    """Questions in the order asked, and what follows wrong answers."""

    title: str
    items: tuple[Question, ...]
    tries: int = 1
    wrong: str = ""  # shown after wrong answers while tries are left; "" says it in the interface's words
    back_to: int | None = None  # the part to which wrong answers lead; None asks again at once
    failed: Literal["go_on", "end"] = "go_on"  # after the last try


class Questions(Activity):
    """Asks each question; may step back to the one before."""

    phase = Phase.QUESTIONS

    def begin(self) -> None:
        """Ask the first."""
        self._plan: QuestionsPlan = self.part.plan
        self._tries = self.stage.tries.get(self.part.name, 0)
        self._wrong = False  # the screen that says so is shown
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))
        self._ask_all()

    def _ask_all(self) -> None:
        self._drafts = [draft_of(asked, rtl=self.stage.words.rtl) for asked in self._plan.items]
        self._right: list[bool | None] = [None] * len(self._drafts)
        self._open(0)

    def _open(self, number: int) -> None:
        self._number = number
        self._shown_ns = self._first_ns = self._changes = 0
        self._note = ""

    def receive(self, happened: Input) -> None:
        """Take an input."""
        match happened:
            case Shown():
                self._shown_ns = self._shown_ns or happened.flip_ns
            case KeyDown() if self._wrong:
                self._go_on_after_wrong(happened)
            case PointerPressed(target="go_on") if self._wrong:
                self._leave_wrong()
            case KeyDown():
                self._key(happened)
            case Typed() if not self._wrong:
                before = self._answer
                self._draft.typed(happened.text)
                self._changed_from(before)
            case PointerPressed(target="go_on"):
                self._give()
            case PointerPressed(target="back"):
                self._step_back()
            case PointerPressed() | PointerMoved() if not self._wrong:
                before = self._answer
                self._draft.point(happened.target, happened.along, down=isinstance(happened, PointerPressed))
                self._changed_from(before)

    def _key(self, press: KeyDown) -> None:
        before = self._answer
        typing = self._draft.asked.kind in ("number", "text", "long_text")
        if self._draft.key(press):
            self.stage.say_key(press, "accepted", self.phase)
            self._changed_from(before)
        elif press.repeat:
            self.stage.say_key(press, "repeat", self.phase)
        elif press.key in (*ENTER, "tab"):
            self.stage.say_key(press, "accepted", self.phase)
            self._give()
        elif press.key == "page_up" and self._number:
            self.stage.say_key(press, "accepted", self.phase)
            self._step_back()
        else:
            self.stage.say_key(press, "typing" if typing else "unmapped", self.phase)

    @property
    def _answer(self) -> tuple[Value, str]:
        return self._draft.value, self._draft.words

    def _changed_from(self, before: tuple[Value, str]) -> None:
        """Say so if the answer is another now."""
        if self._answer == before:
            return
        self._note = ""
        self._changes += 1
        self._first_ns = self._first_ns or self.stage.now_ns
        if self._draft.asked.kind not in ("text", "long_text"):
            value = msgspec.json.encode(self._draft.value).decode()
            self.stage.say(AnswerChanged(self.stage.now_ns, self.number, self._draft.asked.name, value))

    def _step_back(self) -> None:
        if self._number:
            self._open(self._number - 1)

    def _give(self) -> None:
        """Give the answer, unless something is missing."""
        draft, now_ns = self._draft, self.stage.now_ns
        if draft.complaint is not None:
            key, fields = draft.complaint
            self._note = self.stage.words.fill(key, **fields)
            return
        right = is_right(draft.asked, draft.value)
        self._right[self._number] = right
        self.stage.say(
            Answered(
                now_ns,
                self.number,
                self.part.name,
                draft.asked.name,
                draft.asked.kind,
                self._tries + 1,
                msgspec.json.encode(draft.value).decode(),
                draft.words,
                self._shown_ns,
                self._first_ns,
                self._changes,
                right,
            )
        )
        if self._number + 1 < len(self._drafts):
            self._open(self._number + 1)
        else:
            self._conclude()

    def _conclude(self) -> None:
        if False not in self._right:
            self.ended = Ended()
            return
        self._tries += 1
        self.stage.tries[self.part.name] = self._tries
        if self._tries < self._plan.tries:
            self._wrong = True
        elif self._plan.failed == "end":
            detail = f"{self.part.name}: wrong answers after {self._tries} tries"
            self.ended = Ended("failed", reason="screened_out", detail=detail)
        else:
            self.ended = Ended("failed")

    def _go_on_after_wrong(self, press: KeyDown) -> None:
        if press.key in ENTER and not press.repeat:
            self.stage.say_key(press, "accepted", self.phase)
            self._leave_wrong()
        else:
            self.stage.say_key(press, "repeat" if press.repeat else "unmapped", self.phase)

    def _leave_wrong(self) -> None:
        self._wrong = False
        if self._plan.back_to is not None:
            self.ended = Ended("again", back_to=self._plan.back_to)
        else:
            self._ask_all()

    def screen(self) -> QuestionScreen | TextScreen:
        """The question that is asked, or that something was wrong."""
        words = self.stage.words
        if self._wrong:
            return texts.wrong(words, self._plan.wrong)
        return texts.question(
            words,
            title=self._plan.title,
            asked=self._draft.asked,
            item=self._draft.item(),
            number=self._number,
            count=len(self._drafts),
            note=self._note,
        )

    @property
    def asked(self) -> Question:
        """The question that is asked, for whoever answers without reading."""
        return self._draft.asked

    @property
    def _draft(self) -> Draft:
        return self._drafts[self._number]


QUESTIONS = Kind("questions", QuestionsPlan, Questions)
