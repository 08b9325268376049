"""Simulation of a participant who compares clips."""

from typing import get_args

from minihuman.activities.preferences.activity import PreferencesActivity
from minihuman.activities.preferences.events import Side
from minihuman.activities.preferences.plan import PreferencesPlan
from minihuman.activities.preferences.screens import PairScreen
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.screens import Screen
from minihuman.simulation.part_simulation import READING_MS, PartSimulator, SimulatedPerson, name_failures
from minihuman.simulation.participant import SimulatedTeacher


class PreferencesSimulator(PartSimulator):
    """A simulated participant who watches each pair to its end and then chooses a side.

    A participant who is no teacher answers at random.
    """

    def __init__(self, person: SimulatedPerson) -> None:
        super().__init__(person)
        self._last_pair: tuple[int, int] | None = None  # part and pair that were compared last

    def act(self, part: Activity, screen: Screen) -> bool:
        """Answer the pair on the screen once, after its end; return False for any screen but that of a comparison."""
        if not isinstance(screen, PairScreen) or not isinstance(part, PreferencesActivity):
            return False
        if part.pair is None or self._last_pair == part.pair_id:
            return True
        self._last_pair = part.pair_id
        plan: PreferencesPlan = part.part.plan
        teacher = self.person.participant
        delay_ms = READING_MS
        if isinstance(teacher, SimulatedTeacher):
            with name_failures():
                answer, delay_ms = teacher.prefer(*part.pair)
                key = str(getattr(plan, answer))
        else:
            sides = get_args(Side)
            key = str(getattr(plan, sides[self.person.choose(len(sides))]))
        film_ms = (part.length + 1) * plan.step_ms  # the last pictures stay for one more period
        self.person.press_key(key, film_ms + delay_ms)
        return True
