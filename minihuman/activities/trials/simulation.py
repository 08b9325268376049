"""Simulation of a participant in trials with a time course: a response once the target was shown, or none."""

from minihuman.activities.trials.activity import TrialsActivity
from minihuman.activities.trials.schedule import NS_PER_MS
from minihuman.activities.trials.trial_run import TrialRun
from minihuman.experiment.machine.activity import Activity
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.stimuli import NO_RESPONSE, Stimulus
from minihuman.simulation.part_simulation import PartSimulator, SimulatedPerson, ask_key

STOP_SIGNAL = "stop"  # the name of the stimulus that simulated people take for a stop signal


class TrialSimulator(PartSimulator):
    """A simulated participant who responds once to each trial's target."""

    def __init__(self, person: SimulatedPerson) -> None:
        super().__init__(person)
        self._answered_run: TrialRun | None = None  # the latest trial to which a response was scheduled

    def act(self, part: Activity, screen: Screen) -> bool:
        """Schedule the response to a trial once its target was shown; return False if no trial with a timeline runs."""
        if not isinstance(part, TrialsActivity) or part.run is None or part.running_trial is None:
            return False
        run = part.run
        if run is self._answered_run or run.target_onset_ns is None:
            return True
        self._answered_run = run
        play = part.running_trial
        _set_task(play, run)
        self.person.begin_episode(play)
        press = ask_key(self.person.participant, play)
        if press is not None:
            since_target_ns = self.person.now_ns - run.target_onset_ns
            delay_ms = max(0.0, press.delay_ms - since_target_ns / NS_PER_MS)
            self.person.press_key(press.key, delay_ms, press.hold_ms)
        return True


def _set_task(play: RunningEpisode, run: TrialRun) -> None:
    """Set on the trial's world what simulated people respond to: the responses that cells name, and the stop signal.

    The cell of the correct response does not count.
    """
    world = play.world.unwrapped
    if not isinstance(world, Stimulus):
        return
    cells = [cell for name, cell in (play.plan.labels | play.plan.options).items() if name != "correct"]
    cell_texts = {str(cell).strip().lower() for cell in cells}
    world.prompted_responses = tuple(name for name in world.action_names if name.lower() in cell_texts)
    schedule = run.schedule
    stop_ns = schedule.find_onset_ns(STOP_SIGNAL)
    if stop_ns is None or world.correct_response != NO_RESPONSE:
        return
    world.stop_delay_ms = (stop_ns - schedule.target_ns) / NS_PER_MS
    world.go_response = next(iter(world.prompted_responses), "")
