"""Simulation of a participant who answers questions."""

from minihuman.activities.questions.activity import QuestionsActivity
from minihuman.activities.questions.question import Click
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.screens import QuestionScreen, Screen
from minihuman.simulation.part_simulation import PartSimulator


class QuestionsSimulator(PartSimulator):
    """A simulated participant who answers as the question's kind prescribes.

    Opinions are drawn at random; most participants attend and give the right answer where there is one.
    """

    def act(self, part: Activity, screen: Screen) -> bool:
        """Make the next input of the answer, or leave the answered question; return False for any other screen."""
        if not isinstance(screen, QuestionScreen) or not isinstance(part, QuestionsActivity):
            return False
        match part.draft.simulate(self.person.choose, self.person.attends):
            case Click(target, along):
                self.person.point(target, along)
            case str() as text:
                self.person.type_text(text)
            case None:
                self.person.press_key("tab")
        return True
