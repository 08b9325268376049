"""Simulation of a participant who reviews episodes."""

from minihuman.activities.correction.activity import CorrectionActivity
from minihuman.activities.correction.plan import CorrectionPlan
from minihuman.activities.correction.screens import FilmScreen
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.screens import Screen
from minihuman.simulation.part_simulation import READING_MS, PartSimulator, SimulatedPerson, name_failures
from minihuman.simulation.participant import SimulatedTeacher

STEPPING_MS = 200.0  # from one picture to the next, through an episode that is looked at


class CorrectionSimulator(PartSimulator):
    """A simulated participant who skips through the episodes under review.

    A teacher first goes to the step from which they demonstrate what should have been done, once per episode.
    """

    def __init__(self, person: SimulatedPerson) -> None:
        super().__init__(person)
        self._last_review: tuple[int, int] | None = None  # part and episode

    def act(self, part: Activity, screen: Screen) -> bool:
        """Step to the episode's next correction and begin it, or go to the next episode.

        Return False for any screen but that of an episode under review.
        """
        if not isinstance(screen, FilmScreen) or not isinstance(part, CorrectionActivity):
            return False
        if part.reviewed_episode is None:
            return True
        plan: CorrectionPlan = part.part.plan
        episode, current_step = part.reviewed_episode
        teacher = self.person.participant
        correction_step = None
        if isinstance(teacher, SimulatedTeacher) and part.review_id != self._last_review:
            with name_failures():
                correction_step = teacher.correct(episode)
        self._last_review = part.review_id
        if correction_step is None:
            self.person.press_key("enter")
            return True
        key = plan.forward if correction_step > current_step else plan.back
        n_presses = abs(correction_step - current_step)
        for press_index in range(n_presses):
            self.person.press_key(key, READING_MS + press_index * STEPPING_MS)
        self.person.press_key(plan.begin, 2 * READING_MS + n_presses * STEPPING_MS)
        return True
