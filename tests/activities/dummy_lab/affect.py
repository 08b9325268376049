"""A question with two answers, pleasure and arousal: a cell of a grid, whose shapes have names and captions."""

import msgspec

from minihuman.activities.questions.question import Click
from minihuman.experiment.machine.screens import CanvasShape, ShapeCanvas
from minihuman.ext import AnswerDraft, QuestionKind

CAPTION = 0.1  # of the canvas's height


class AffectSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size: int = 3


class AffectDraft(AnswerDraft):
    cell = None  # pleasure and arousal, from 1

    def key(self, press):
        return False

    def point_at(self, target, along, *, down):
        name, _, cell = target.partition(":")
        if down and name == "cell":
            self.cell = tuple(map(int, cell.split(":")))

    @property
    def value(self):
        return self.cell and list(self.cell)

    @property
    def display_text(self):
        return self.cell and describe(self.cell)

    @property
    def answers(self):
        names = self.question.asked
        numbers = self.cell or (None, None)
        return tuple((name, number, str(number)) for name, number in zip(names, numbers, strict=True))

    def widget(self):
        size = self.settings.size
        cells = [(pleasure, arousal) for arousal in range(size, 0, -1) for pleasure in range(1, size + 1)]
        captions = (
            CanvasShape(0, 0, 1, CAPTION, "awake", has_box=False),
            CanvasShape(0, 1 - CAPTION, 1, CAPTION, "sleepy", has_box=False),
        )
        return ShapeCanvas((*captions, *map(self.build_cell, cells)), 1 - 2 * CAPTION, is_tall=True)

    def build_cell(self, cell):
        pleasure, arousal = cell
        size = self.settings.size
        high = (1 - 2 * CAPTION) / size
        return CanvasShape(
            (pleasure - 1) / size,
            CAPTION + (size - arousal) * high,
            1 / size,
            high,
            target=f"cell:{pleasure}:{arousal}",
            chosen=cell == self.cell,
            accessible_name=describe(cell),
        )

    def simulate(self, choose, attends):
        size = self.settings.size
        return None if self.cell else Click(f"cell:{choose(size) + 1}:{choose(size) + 1}")


def describe(cell):
    return "pleasure {}, arousal {}".format(*cell)


def list_components(settings):
    return {"pleasure": "pleasure", "arousal": "arousal"}


AFFECT = QuestionKind(
    "affect",
    AffectDraft,
    "number",
    settings=AffectSettings,
    prompt="Click on a cell, then press Enter",
    components=list_components,
)
