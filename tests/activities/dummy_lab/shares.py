"""A question with an answer for each of its statements: all points are given away, by buttons that have names."""

from minihuman.activities.questions.question import Click
from minihuman.experiment.machine.screens import CanvasShape, ShapeCanvas
from minihuman.ext import AnswerDraft, QuestionKind

POINTS = 3


class SharesDraft(AnswerDraft):
    def __init__(self, question, settings, *, rtl, language):
        super().__init__(question, settings, rtl=rtl, language=language)
        self.points = [0] * len(question.asked)

    def key(self, press):
        return False

    def point_at(self, target, along, *, down):
        name, _, row = target.partition(":")
        if down and name == "share" and sum(self.points) < POINTS:
            self.points[int(row)] += 1

    @property
    def value(self):
        return [*self.points] if sum(self.points) == POINTS else None

    @property
    def display_text(self):
        return ", ".join(map(str, self.points))

    @property
    def answers(self):
        return tuple((name, points, str(points)) for name, points in zip(self.question.asked, self.points, strict=True))

    def widget(self):
        height = 1 / len(self.points)
        statements = self.question.statements.values()
        shapes = []
        for row, (text, points) in enumerate(zip(statements, self.points, strict=True)):
            shapes.append(CanvasShape(0, row * height, 0.8, height, f"{text}: {points}", has_box=False))
            name = f"a point for {text}"
            shapes.append(CanvasShape(0.8, row * height, 0.2, height, "+1", f"share:{row}", accessible_name=name))
        return ShapeCanvas(tuple(shapes), 2)

    def simulate(self, choose, attends):
        return Click(f"share:{choose(len(self.points))}") if self.value is None else None


SHARES = QuestionKind(
    "shares",
    SharesDraft,
    "number",
    prompt="Give all points, then press Enter",
    has_statements=True,
    example={"statements": {"self": "yourself", "other": "the other"}},
)
