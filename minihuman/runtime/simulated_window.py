"""A window with a simulated participant, who reads texts in a second and answers as they ask."""

from collections.abc import Callable
from importlib import import_module

from minihuman.display.windows.window import VirtualClock, Window
from minihuman.errors import PlayerFailedError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.inputs import (
    Input,
    KeyDown,
    KeyUp,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    TextInput,
)
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import ActivityScreen, PageScreen, PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.simulation.part_simulation import (
    HOLD_MS,
    LONGEST_NS,
    READING_MS,
    PartSimulator,
    SimulatedPerson,
    ask_key,
    name_failures,
)
from minihuman.simulation.participant import SimulatedParticipant

FRAME_NS = 16_666_667  # of a display of 60 Hz
_MIDDLE = 0.5  # of the screen, at which the pointer is reported
MOST_USELESS_PRESSES = 1_000  # in a row that lead to no step


class SimulatedWindow(Window, SimulatedPerson):
    """Presses keys for a simulated participant, who reads texts in a second and answers as they ask.

    Args:
        player: the simulated participant, who presses the keys while playing.
        session: the participant's session, which has the world that the player sees.
        clock: the session's clock; waiting advances it.
        before: the number of earlier participants of this slot who left no data.
        wrong_in_ten: how many in ten answers to questions with a correct answer are random.
        at_rest: called between episodes, when nothing is urgent.
    """

    def __init__(
        self,
        player: SimulatedParticipant,
        session: SessionMachine,
        clock: VirtualClock,
        *,
        before: int = 0,
        wrong_in_ten: int = 1,
        at_rest: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(player)
        self._before = before
        self.wrong_in_ten = wrong_in_ten
        self._session = session
        self._clock = clock
        self._at_rest = at_rest
        self._screen: Screen = TextScreen("", "", "")
        self._last_play: RunningEpisode | None = None  # the episode that the player was shown last
        self._simulators: dict[str, PartSimulator | None] = {}  # by kind of part; None for a kind without one
        self._n_draws = 0
        self._steps_at_last_key = 0  # steps of the running episode at the last key
        self._useless_presses = 0  # keys since the last step
        self._withheld: tuple[RunningEpisode, int] | None = None  # the trial and step without a response
        self._last_ns = 0  # time of the last input or new screen
        self._coming: list[Input] = []  # scheduled inputs, in order of time

    def show(self, screen: Screen) -> ScreenShown:
        """Show a screen to the player; it counts as displayed one frame later, or at the time when it is due."""
        self._screen = screen
        submit_ns = self._last_ns = self._clock()
        due_ns = None
        if isinstance(screen, ActivityScreen):
            due_ns = screen.due_ns
        if due_ns is None or due_ns < submit_ns:
            due_ns = submit_ns + FRAME_NS
        self._clock.advance_to(due_ns)
        if not isinstance(screen, PlayScreen):
            self._at_rest()
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Advance the clock to the player's next input and return it, or to ``until_ns`` and return nothing.

        Raises:
            PlayerFailedError: if the player presses no key for an hour, or too many that lead to no step.
        """
        if not any(isinstance(happened, KeyDown | PointerPressed | TextInput) for happened in self._coming):
            self._schedule_next()
        if not self._coming or (until_ns is not None and until_ns < self._coming[0].t_ns):
            assert until_ns is not None, "neither a key nor a deadline: this would wait for ever"
            if until_ns > self._last_ns + LONGEST_NS:
                raise PlayerFailedError(f"no key was pressed for an hour in phase {self._session.phase}", "no key")
            self._clock.advance_to(until_ns)
            return []
        happened = self._coming.pop(0)
        self._last_ns = max(self._last_ns, happened.t_ns)
        self._clock.advance_to(happened.t_ns)
        return [happened]

    def facts(self) -> dict[str, str]:
        """Return the facts about the window."""
        return {"window": "simulated"}

    def close(self) -> None:
        """Do nothing, since this window holds no resources."""

    # What the simulators of parts can do

    @property
    def now_ns(self) -> int:
        """Return the session's time in nanoseconds."""
        return self._clock()

    def begin_episode(self, play: RunningEpisode) -> None:
        """Show the player an episode, if it is a new one."""
        if play is not self._last_play:
            self._last_play = play
            with name_failures():
                self.participant.begin(play.plan, self._session.plan.key_pool, play.world)

    def press_key(self, key: str, delay_ms: float = READING_MS, hold_ms: float = HOLD_MS) -> None:
        """Schedule the press of a key ``delay_ms`` from now, and its release ``hold_ms`` later."""
        down_ns = self._clock() + round(delay_ms * NS_PER_MS)
        up_ns = down_ns + round(hold_ms * NS_PER_MS)
        self._coming += [KeyDown(down_ns, key, key), KeyUp(up_ns, key, key)]
        self._coming.sort(key=lambda happened: happened.t_ns)

    def point(self, target: str, along: float) -> None:
        """Schedule a click on a target of the screen, at a position along it from 0 to 1."""
        down_ns = self._clock() + round(READING_MS * NS_PER_MS)
        up_ns = down_ns + round(HOLD_MS * NS_PER_MS)
        self._coming += [
            PointerPressed(down_ns, _MIDDLE, _MIDDLE, target, along),
            PointerReleased(up_ns, _MIDDLE, _MIDDLE, target, along),
        ]

    def type_text(self, text: str) -> None:
        """Schedule the typing of a text after the reading time."""
        self._coming.append(TextInput(self._clock() + round(READING_MS * NS_PER_MS), text))

    def choose(self, count: int) -> int:
        """Draw a number from 0 to ``count`` - 1, which the study's seed, the participant and earlier draws fix."""
        plan = self._session.plan
        purpose = f"simulated-answers-session-{plan.session}"
        if self._before:
            purpose += f"-after-{self._before}"
        self._n_draws += 1
        words = draw_words(self._n_draws, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        return int(words[-1] % count)

    # What is pressed next

    def _schedule_next(self) -> None:
        """Schedule the player's next input: that of the part's own rules, else of its simulator, else the usual one."""
        part = self._session.part
        if self._session.phase is part.phase:
            key = part.simulate(self.choose)
            if key is not None:
                self.press_key(key)
                return
        simulator = self._find_simulator(part.part.kind)
        if simulator is None or not simulator.act(part, self._screen):
            self._schedule_usual_input()

    def _find_simulator(self, kind: str) -> PartSimulator | None:
        """Return the simulator of a kind's parts; None if the kind has none."""
        if kind not in self._simulators:
            module, _, name = find_kind(kind).simulator.partition(":")
            self._simulators[kind] = getattr(import_module(module), name)(self) if module else None
        return self._simulators[kind]

    def _schedule_usual_input(self) -> None:
        """Schedule the usual input for a screen that parts of every kind may show."""
        match self._screen:
            case PlayScreen() if self._session.play is not None:  # otherwise the last picture is held
                self._schedule_press(self._session.play)
            case PageScreen():
                self.press_key("enter")
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self.press_key(missing[0])
            case TextScreen() if self._session.next_tick_ns is None:  # otherwise a rest is running
                self.press_key("enter")

    def _schedule_press(self, play: RunningEpisode) -> None:
        """Schedule the player's next key press, or a withheld response, in an episode."""
        if self._withheld == (play, play.steps):
            return
        self.begin_episode(play)
        if play.steps != self._steps_at_last_key:
            self._useless_presses = 0
        else:
            self._useless_presses += 1
        self._steps_at_last_key = play.steps
        if self._useless_presses > MOST_USELESS_PRESSES:
            message = f"{MOST_USELESS_PRESSES} keys in a row led to no step of {play.plan.world}"
            raise PlayerFailedError(message, "no key that steps")
        press = ask_key(self.participant, play)
        if press is None:
            self._withheld = play, play.steps
        else:
            self.press_key(press.key, press.delay_ms, press.hold_ms)
