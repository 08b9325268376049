"""A question of which colour one's mood has: codes and colours of its own, a note of its own, in three languages."""

import msgspec

from minihuman.activities.questions.question import Click
from minihuman.experiment.machine.screens import CanvasShape, ShapeCanvas
from minihuman.ext import AnswerDraft, QuestionKind


class MoodSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    colours: dict[str, str] = msgspec.field(default_factory=lambda: {"sad": "#2266cc", "glad": "#ffee55"})  # by code


class MoodDraft(AnswerDraft):
    answer = None

    def key(self, press):
        codes = dict(zip("123456789", self.settings.colours, strict=False))
        self.answer = codes.get(press.key, self.answer)
        return press.key in codes

    def point_at(self, target, along, *, down):
        if down and target in self.settings.colours:
            self.answer = target

    @property
    def value(self):
        return self.answer

    @property
    def display_text(self):
        return self.answer or ""

    @property
    def error(self):
        return None if self.answer else ("note.mood", {"count": len(self.settings.colours)})

    def widget(self):
        width = 1 / len(self.settings.colours)
        shapes = (
            CanvasShape(place * width, 0, width, 1, code, code, code == self.answer, fill=colour)
            for place, (code, colour) in enumerate(self.settings.colours.items())
        )
        return ShapeCanvas(tuple(shapes))

    def simulate(self, choose, attends):
        codes = [*self.settings.colours]
        return Click(codes[choose(len(codes))]) if self.answer is None else None


def list_codes(settings):
    return tuple(settings.colours)


MOOD = QuestionKind("mood", MoodDraft, "code", item_fields=(), settings=MoodSettings, codes=list_codes)
