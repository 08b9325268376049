"""Questionnaires: ask questions one after the other, with a number of tries where answers can be wrong."""

from typing import Any

import msgspec

from minihuman.activities.questions.field_rules import describe_field, describe_slider
from minihuman.activities.questions.free_text.draft import TextDraft
from minihuman.activities.questions.number.draft import NUMBER_RULES
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.questions.question import (
    AnswerDraft,
    AnswerValue,
    build_draft,
    find_question_kind,
    is_correct,
)
from minihuman.activities.questions.screens import build_question_screen, build_wrong_answer_screen
from minihuman.activities.questions.server_needs import find_server_needs
from minihuman.activities.questions.slider.draft import SliderDraft
from minihuman.experiment.machine.activity import ENTER_KEYS, Activity, ActivityKind, AnswerField, PartEnding
from minihuman.experiment.machine.events import AnswerChanged, Answered, Noted, TextChanged
from minihuman.experiment.machine.inputs import (
    TEXT_RULES,
    Input,
    KeyDown,
    PointerMoved,
    PointerPressed,
    ScreenShown,
    TextEdited,
    TextInput,
)
from minihuman.experiment.machine.screens import QuestionScreen, TextScreen
from minihuman.experiment.machine.transitions import Phase


class QuestionsActivity(Activity):
    """An activity that asks the questions of a questionnaire; the participant can step back to earlier ones."""

    phase = Phase.QUESTIONS
    can_copy = True

    def begin(self) -> None:
        """Log the phase and show the first question, with the tries that the session has used so far."""
        self._plan: QuestionsPlan = self.part.plan
        self._tries = self.context.tries.get(self.part.name, 0)
        self._wrong = False  # whether the screen that announces wrong answers is shown
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))
        self._start_over()

    def _start_over(self) -> None:
        """Discard all answers and show the first question."""
        words = self.context.words
        has_current_rules = self.context.facts.get("number_rules", "1") == NUMBER_RULES
        language = words.language if has_current_rules else None
        limit_note = ""
        if self.context.facts.get("text_rules", "1") == TEXT_RULES:
            limit_note = words["note.too_long"]
        self._drafts = [
            build_draft(question, rtl=words.rtl, language=language, limit_note=limit_note)
            for question in self._plan.items
        ]
        self._right: list[bool | None] = [None] * len(self._drafts)
        self._show_question(0)

    def _show_question(self, number: int) -> None:
        """Show the question of an index, with its time of display, its changes and its note reset."""
        self._number = number
        self._shown_ns = 0
        self._first_ns = 0
        self._changes = 0
        self._note = ""

    def receive(self, happened: Input) -> None:
        """Handle an input: a change of the answer, a step to another question, or the end of a note."""
        match happened:
            case ScreenShown():
                self._shown_ns = self._shown_ns or happened.flip_ns
            case KeyDown() if self._wrong:
                self._go_on_after_wrong(happened)
            case PointerPressed(target="go_on") if self._wrong:
                self._leave_wrong()
            case KeyDown():
                self._press_key(happened)
            case TextInput() if not self._wrong:
                previous_answer = self._answer
                self.draft.type_text(happened.text)
                self._note_change(previous_answer)
            case TextEdited() if not self._wrong:
                self._edit_text(happened)
            case PointerPressed(target="go_on"):
                self._give_answer()
            case PointerPressed(target="back"):
                self._step_back()
            case PointerPressed() | PointerMoved() if not self._wrong:
                previous_answer = self._answer
                self.draft.point_at(happened.target, happened.along, down=isinstance(happened, PointerPressed))
                self._note_change(previous_answer)

    def _edit_text(self, edited: TextEdited) -> None:
        """Replace the answer by the whole text of a native field and log it; show a note at once if it is too long.

        A text of another question's field, or one that the answer does not accept, changes nothing.
        """
        previous_answer = self._answer
        name = self.draft.question.name
        if edited.field not in ("", name) or not self.draft.put_text(edited.text):
            return
        now_ns = self.context.now_ns
        began_ns = min(edited.began_ns or now_ns, now_ns)
        waited_ns = now_ns - began_ns
        self.context.emit(TextChanged(now_ns, self.number, name, edited.text, edited.changes, edited.keys, waited_ns))
        self._first_ns = self._first_ns or began_ns
        self._note_change(previous_answer)
        if (error := self.draft.error) is not None and error[0] == "note.too_long":
            self._note = self.context.words.fill(error[0], **error[1])

    def _press_key(self, press: KeyDown) -> None:
        """Handle a key press: edit the answer, give it, or step back to the question before."""
        previous_answer = self._answer
        if self.draft.key(press):
            self.context.emit_key(press, "accepted", self.phase)
            self._note_change(previous_answer)
        elif press.repeat:
            self.context.emit_key(press, "repeat", self.phase)
        elif press.key in (*ENTER_KEYS, "tab"):
            self.context.emit_key(press, "accepted", self.phase)
            self._give_answer()
        elif press.key == "page_up" and self._number > self._asked_numbers[0]:
            self.context.emit_key(press, "accepted", self.phase)
            self._step_back()
        else:
            takes_text = find_question_kind(self.draft.question.kind).takes_text
            self.context.emit_key(press, "typing" if takes_text else "unmapped", self.phase)

    @property
    def _answer(self) -> tuple[AnswerValue, str]:
        """Return the value and the text of the present answer, by which a change is noticed."""
        return self.draft.value, self.draft.display_text

    def _note_change(self, previous_answer: tuple[AnswerValue, str]) -> None:
        """Count a change, remove the note and log the new value, if the answer differs from the previous one.

        A change of a text is logged elsewhere, when the text settles.
        """
        if self._answer == previous_answer:
            return
        self._note = ""
        self._changes += 1
        self._first_ns = self._first_ns or self.context.now_ns
        if find_question_kind(self.draft.question.kind).answer_type != "text":
            value_json = msgspec.json.encode(self.draft.value).decode()
            self.context.emit(AnswerChanged(self.context.now_ns, self.number, self.draft.question.name, value_json))

    def _step_back(self) -> None:
        """Show the previous question again, if there is one."""
        earlier_numbers = [number for number in self._asked_numbers if number < self._number]
        if earlier_numbers:
            self._show_question(earlier_numbers[-1])

    def _give_answer(self) -> None:
        """Log the answer and continue, or show a note if the answer is missing or not valid."""
        draft = self.draft
        now_ns = self.context.now_ns
        if draft.error is not None:
            key, fields = draft.error
            self._note = self.context.words.with_kind(draft.question.kind).fill(key, **fields)
            return
        is_answer_correct = is_correct(draft.question, draft.value)
        self._right[self._number] = is_answer_correct
        for name, answer, display_text in draft.answers:
            self.context.emit(
                Answered(
                    t_ns=now_ns,
                    part=self.number,
                    part_name=self.part.name,
                    item=name,
                    kind=draft.question.kind,
                    attempt=self._tries + 1,
                    value=msgspec.json.encode(answer).decode(),
                    words=display_text,
                    shown_ns=self._shown_ns,
                    first_ns=self._first_ns,
                    changes=self._changes,
                    right=is_answer_correct,
                )
            )
        later_numbers = [number for number in self._asked_numbers if number > self._number]
        if later_numbers:
            self._show_question(later_numbers[0])
        else:
            self._conclude()

    @property
    def _asked_numbers(self) -> list[int]:
        """Return the indices of the questions to ask; ``only_if`` excludes some, depending on the answers so far."""
        answers_by_name: dict[str, list[Any]] = {}  # of the questions to ask
        numbers = []
        for number, draft in enumerate(self._drafts):
            conditions = draft.question.only_if or {}
            if not all(set(answers_by_name.get(name, ())) & set(answers) for name, answers in conditions.items()):
                continue
            numbers.append(number)
            for name, answer, _ in draft.answers:
                answers_by_name[name] = answer if isinstance(answer, list) else [answer]
        return numbers

    def _conclude(self) -> None:
        """End the questionnaire, or allow another try after wrong answers if the plan has one left."""
        if not any(self._right[number] is False for number in self._asked_numbers):
            self.ended = PartEnding()
            return
        self._tries += 1
        self.context.tries[self.part.name] = self._tries
        if self._tries < self._plan.tries:
            self._wrong = True
        elif self._plan.failed == "end":
            detail = f"{self.part.name}: wrong answers after {self._tries} tries"
            self.ended = PartEnding("failed", reason="screened_out", detail=detail)
        else:
            self.ended = PartEnding("failed")

    def _go_on_after_wrong(self, press: KeyDown) -> None:
        """Handle a key press on the screen that announces wrong answers; Enter leaves it."""
        if press.key in ENTER_KEYS and not press.repeat:
            self.context.emit_key(press, "accepted", self.phase)
            self._leave_wrong()
        else:
            self.context.emit_key(press, "repeat" if press.repeat else "unmapped", self.phase)

    def _leave_wrong(self) -> None:
        """Leave the screen that announces wrong answers: return to the part to read again, or ask all over again."""
        self._wrong = False
        if self._plan.back_to is not None:
            self.ended = PartEnding("again", back_to=self._plan.back_to)
        else:
            self._start_over()

    @property
    def history(self) -> tuple[object, ...]:
        """Return each answer with whether it is right, if the further course can depend on the answers; otherwise ().

        It depends on them if a question has a condition or a right answer.
        """
        if not any(question.only_if or question.right is not None for question in self._plan.items):
            return ()
        answers = (msgspec.json.encode((draft.value, draft.display_text)).decode() for draft in self._drafts)
        return tuple(zip(answers, self._right, strict=True))

    @property
    def answer_field(self) -> AnswerField | None:
        """Return a description of the present question's text field or slider.

        None means that the question has neither, or that the screen that announces wrong answers covers it.
        """
        if self._wrong:
            return None
        match self.draft:
            case TextDraft() as draft:
                return describe_field(draft)
            case SliderDraft() as draft:
                return describe_slider(draft)
        return None

    def screen(self) -> QuestionScreen | TextScreen:
        """Build the screen of the present question, or the screen that announces wrong answers."""
        words = self.context.words
        if self._wrong:
            return build_wrong_answer_screen(words, self._plan.wrong)
        return build_question_screen(
            words,
            title=self._plan.title,
            draft=self.draft,
            number=self._asked_numbers.index(self._number),
            count=len(self._asked_numbers),
            note=self._note,
        )

    @property
    def draft(self) -> AnswerDraft:
        """Return the draft of the answer to the present question."""
        return self._drafts[self._number]


QUESTIONS = ActivityKind(
    "questions",
    QuestionsPlan,
    QuestionsActivity,
    tables="minihuman.activities.questions.tables:QUESTION_TABLES",
    simulator="minihuman.activities.questions.simulation:QuestionsSimulator",
    find_server_needs=find_server_needs,
    is_for_players=True,
    is_check=True,
)
