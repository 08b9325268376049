"""A question whose answer is an order: its options' codes, in the order in which they were pressed."""

from minihuman.activities.questions.question import Click, parse_digit, parse_option
from minihuman.experiment.machine.screens import OptionList
from minihuman.ext import AnswerDraft, QuestionKind


class WishesDraft(AnswerDraft):
    def __init__(self, question, settings, *, rtl, language):
        super().__init__(question, settings, rtl=rtl, language=language)
        self.places = []

    @property
    def model_request(self):
        return "Answer with the numbers of all wishes, the dearest first."

    def key(self, press):
        digit = parse_digit(press.key)
        if 1 <= digit <= len(self.question.options):
            self.toggle(digit - 1)
            return True
        return False

    def point_at(self, target, along, *, down):
        place = parse_option(target)
        if down and place is not None:
            self.toggle(place)

    def toggle(self, place):
        if place in self.places:
            self.places.remove(place)
        else:
            self.places.append(place)

    @property
    def value(self):
        if len(self.places) < len(self.question.options):
            return None
        return [self.question.all_codes[place] for place in self.places]

    @property
    def display_text(self):
        return ", ".join(self.question.options[place] for place in self.places)

    def widget(self):
        return OptionList(self.question.options, tuple(self.places), 0, True)

    def simulate(self, choose, attends):
        left = [place for place in range(len(self.question.options)) if place not in self.places]
        return Click(f"option:{left[choose(len(left))]}") if left else None


WISHES = QuestionKind("wishes", WishesDraft, "order", example={"options": ("a", "b", "c")})
