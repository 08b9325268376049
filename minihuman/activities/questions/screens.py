"""Screens of questionnaires."""

from minihuman.activities.questions.question import AnswerDraft, find_question_kind
from minihuman.experiment.machine.screens import Button, QuestionScreen, TextScreen
from minihuman.experiment.words import InterfaceWords


def build_question_screen(
    words: InterfaceWords,
    *,
    title: str,
    draft: AnswerDraft,
    number: int,
    count: int,
    note: str,
) -> QuestionScreen:
    """Build the screen of a question with its answer so far.

    Args:
        words: the interface's texts.
        title: the questionnaire's title.
        draft: the answer so far.
        number: the question's index among those that are asked.
        count: how many questions are asked.
        note: why the answer cannot be given; "" for no note.
    """
    buttons = [Button("go_on", words["button.go_on"])]
    if number > 0:
        buttons.insert(0, Button("back", words["button.back"]))
    progress = ""
    if count > 1:
        progress = words.fill("question.progress", number=number + 1, count=count)
    question = draft.question
    kind_words = words.with_kind(question.kind)
    prompt = kind_words.find(f"prompt.{question.kind}", find_question_kind(question.kind).prompt)
    return QuestionScreen(title, question.ask, draft.widget(), prompt, tuple(buttons), progress, note, words.locale)


def build_wrong_answer_screen(words: InterfaceWords, text: str) -> TextScreen:
    """Build the screen that announces another attempt after wrong answers; an empty text shows the standard one."""
    return TextScreen(words["wrong.title"], text.strip() or words["wrong.body"], words["go_on"], locale=words.locale)
