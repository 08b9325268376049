"""Simulation of a person who watches an agent play."""

from minihuman.activities.agent_blocks.activity import AgentPlayActivity
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.simulation.part_simulation import (
    PartSimulator,
    SimulatedPerson,
    ask_key,
    check_press,
    name_failures,
)
from minihuman.simulation.participant import KeyPress, SimulatedTeacher, WatchedStep


def build_watched_step(part: AgentPlayActivity, play: RunningEpisode, t_ns: int) -> WatchedStep:
    """Build the description of an episode's state at a session time that a simulated teacher receives."""
    advised = part.advised
    action = "" if advised is None else play.world.action_names[advised.action]
    has_reached_goal = play.outcome == "goal"
    return WatchedStep(
        part.controller, play.steps, t_ns / NS_PER_MS, action, part.hand_back_key, *part.rating_keys, has_reached_goal
    )


class AgentBlockSimulator(PartSimulator):
    """A simulated participant who looks at each state once.

    Only a teacher intervenes; other participants act only in episodes without an agent.
    """

    def __init__(self, person: SimulatedPerson) -> None:
        super().__init__(person)
        self._last_play: RunningEpisode | None = None
        self._last_state = ("", -1)  # who was in control, and the step

    def act(self, part: Activity, screen: Screen) -> bool:
        """Respond once to each new state of the episode on the screen.

        Return False for any screen but that of an agent block's episode, which another simulator has to handle.
        """
        if not isinstance(screen, PlayScreen) or not isinstance(part, AgentPlayActivity):
            return False
        play = part.play if part.playing else part.rated_episode
        if play is None:
            return True
        self.person.begin_episode(play)
        state = (part.controller, play.steps)
        if self._last_play is play and self._last_state == state:
            return True
        self._last_play = play
        self._last_state = state
        press = self._decide(part, play)
        if press is not None:
            self.person.press_key(press.key, press.delay_ms, press.hold_ms)
        return True

    def _decide(self, part: AgentPlayActivity, play: RunningEpisode) -> KeyPress | None:
        """Return the key press with which a teacher, or a participant in control, responds now; None for no press."""
        participant = self.person.participant
        if isinstance(participant, SimulatedTeacher):
            with name_failures():
                press = participant.watch(play.world, build_watched_step(part, play, self.person.now_ns))
            if press is None:
                return None
            return check_press(press)
        if part.controller == "person":
            return ask_key(participant, play)
        return None
