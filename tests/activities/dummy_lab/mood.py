from minihuman.activities.questions.question import Click
from minihuman.experiment.machine.screens import CanvasShape, ShapeCanvas
from minihuman.ext import AnswerDraft, QuestionKind


class MoodDraft(AnswerDraft):
    answer = None

    def key(self, press):
        self.answer = {"1": "sad", "2": "glad"}.get(press.key, self.answer)
        return press.key in ("1", "2")

    def point_at(self, target, along, *, down):
        if down and target in ("sad", "glad"):
            self.answer = target

    @property
    def value(self):
        return self.answer

    @property
    def display_text(self):
        return self.answer or ""

    def widget(self):
        names = ("sad", "glad")
        shapes = (CanvasShape(n / 2, 0, 0.5, 1, name, name, name == self.answer) for n, name in enumerate(names))
        return ShapeCanvas(tuple(shapes))

    def simulate(self, choose, attends):
        return Click(("sad", "glad")[choose(2)]) if self.answer is None else None


MOOD = QuestionKind("mood", MoodDraft, "text")
