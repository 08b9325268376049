"""A window with nobody in front of it: a player presses the keys, on a virtual clock, and no picture is drawn."""

from collections.abc import Callable
from typing import get_args

from minihuman.errors import PlayerError
from minihuman.players.port import Player
from minihuman.players.teacher import Teacher, Watched
from minihuman.study.activities.agent_play import AgentPlaying
from minihuman.study.activities.correction import Correction, CorrectionPlan
from minihuman.study.activities.pair_events import Verdict
from minihuman.study.activities.port import Activity
from minihuman.study.activities.preferences import Preferences, PreferencesPlan
from minihuman.study.activities.questions import Questions
from minihuman.study.activities.rating import Rating
from minihuman.study.chance import words
from minihuman.study.inputs import Input, KeyDown, KeyUp, PointerPressed, PointerReleased, Shown, Typed
from minihuman.study.play import Play
from minihuman.study.screens import (
    Choices,
    Entry,
    FilmScreen,
    PageScreen,
    PairScreen,
    PlayScreen,
    QuestionScreen,
    Scale,
    Screen,
    Slider,
    TextScreen,
)
from minihuman.study.session import Session
from minihuman.windows.port import Window
from minihuman.windows.scripted import VirtualClock

NS_PER_MS = 1_000_000
FRAME_NS = 16_666_667
READING_MS = 1_000.0
STEPPING_MS = 200.0  # from one picture to the next, through an episode that is looked at
HOLD_MS = 90.0
LONGEST_NS = 3_600_000_000_000  # without a key and a new screen


class SimulatedWindow(Window):
    """Hands the session what a player presses; texts are read in a second and answered as they ask.

    Args:
        player: presses the keys while playing.
        session: the session it sits in, for the world that the player looks at.
        clock: the session's; waiting moves it.
        before: how many sat in this participant's place before and left no data.
        wrong_in_ten: of answers to questions that have a right one, how many in ten are any answer.
        at_rest: called between episodes, when nothing is urgent.
    """

    def __init__(
        self,
        player: Player,
        session: Session,
        clock: VirtualClock,
        *,
        before: int = 0,
        wrong_in_ten: int = 1,
        at_rest: Callable[[], None] = lambda: None,
    ) -> None:
        self._before = before
        self._wrong_in_ten = wrong_in_ten
        self._player = player
        self._session = session
        self._clock = clock
        self._at_rest = at_rest
        self._screen: Screen = TextScreen("", "", "")
        self._playing: Play | None = None
        self._looked: tuple[str, int] | None = None  # who steered and which step it was when the player looked last
        self._answers = 0  # given so far
        self._last_ns = 0  # of the last key, and of the last new screen
        self._compared: tuple[int, int] | None = None  # part and pair that were looked at last
        self._looked_through: tuple[int, int] | None = None  # part and episode
        self._coming: list[Input] = []  # in order of time

    def show(self, screen: Screen) -> Shown:
        """Look at a screen; it is there one frame later."""
        self._screen = screen
        submit_ns = self._last_ns = self._clock()
        self._clock.advance_to(submit_ns + FRAME_NS)
        if not isinstance(screen, PlayScreen):
            self._at_rest()
        return Shown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Move the clock to the player's next key, or to ``until_ns``."""
        if not any(isinstance(happened, KeyDown | PointerPressed | Typed) for happened in self._coming):
            self._think()
        if not self._coming or (until_ns is not None and until_ns < self._coming[0].t_ns):
            assert until_ns is not None, "neither a key nor a deadline: this would wait for ever"
            if until_ns > self._last_ns + LONGEST_NS:
                raise PlayerError(f"nothing was pressed for an hour while {self._session.phase}; let another play this")
            self._clock.advance_to(until_ns)
            return []
        happened = self._coming.pop(0)
        self._last_ns = max(self._last_ns, happened.t_ns)
        self._clock.advance_to(happened.t_ns)
        return [happened]

    def facts(self) -> dict[str, str]:
        """What it is."""
        return {"window": "simulated"}

    def close(self) -> None:
        """Nothing to give back."""

    def _think(self) -> None:
        """Decide on the next key."""
        match self._screen:
            case PlayScreen() if self._session.play is not None and isinstance(self._session.part, AgentPlaying):
                self._watch(self._session.part, self._session.play)
            case PlayScreen() if isinstance(rating := self._session.part, Rating) and rating.held is not None:
                self._watch(rating, rating.held)
            case PlayScreen() if self._session.play is not None:  # else the last picture is held
                self._press(*self._play(self._session.play))
            case PairScreen():
                self._prefer(self._session.part)
            case FilmScreen():
                self._look(self._session.part)
            case PageScreen():
                self._press("enter", READING_MS)
            case QuestionScreen():
                self._answer(self._screen)
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self._press(missing[0], READING_MS)
            case TextScreen() if self._session.next_tick_ns is None:  # else a rest is running: nothing to press yet
                self._press("enter", READING_MS)

    def _look(self, part: Activity) -> None:
        """Look an episode through; a teacher goes to the step from which they show what should have been done, once."""
        if not isinstance(part, Correction) or part.looked_at is None:
            return
        plan: CorrectionPlan = part.part.plan
        episode, at = part.looked_at
        step = None
        if isinstance(self._player, Teacher) and part.number_of_look != self._looked_through:
            step = self._player.correct(episode)
        self._looked_through = part.number_of_look
        if step is None:
            self._press("enter", READING_MS)
            return
        key, steps = plan.forward if step > at else plan.back, abs(step - at)
        for number in range(steps):
            self._press(key, READING_MS + number * STEPPING_MS)
        self._press(plan.begin, 2 * READING_MS + steps * STEPPING_MS)

    def _prefer(self, part: Activity) -> None:
        """Look at a pair to its end, then say which side is better: any, for whoever is no teacher."""
        if not isinstance(part, Preferences) or part.pair is None or self._compared == part.number_of_pair:
            return
        plan: PreferencesPlan = part.part.plan
        seen_ms = (part.length + 1) * plan.step_ms
        self._compared = part.number_of_pair
        if isinstance(self._player, Teacher):
            said, delay_ms = self._player.prefer(*part.pair)
        else:
            said, delay_ms = get_args(Verdict)[self._any(2)], READING_MS
        self._press(getattr(plan, said), seen_ms + delay_ms)

    def _answer(self, question: QuestionScreen) -> None:
        """Any answer, each as likely as another: nothing is known of what these people think. They have read, though:
        where there is a right answer, most give it.
        """
        match question.item:
            case Choices(chosen=chosen) if not chosen and (right := self._right_option()) is not None:
                self._point(f"option:{right}")
            case Choices(options=options, chosen=chosen) if not chosen:
                self._point(f"option:{self._any(len(options))}")
            case Scale(points=points, chosen=None):
                self._point(f"option:{self._any(len(points))}")
            case Slider(along=None):
                self._point("slider", self._any(21) / 20)
            case Entry(text=""):
                self._type(str(18 + self._any(50)))
            case _:
                self._press("tab", READING_MS)

    def _right_option(self) -> int | None:
        part = self._session.part
        if not isinstance(part, Questions) or part.asked.right is None or self._any(10) < self._wrong_in_ten:
            return None
        right = part.asked.right if isinstance(part.asked.right, tuple) else (part.asked.right,)
        return next((place for place, code in enumerate(part.asked.all_codes) if code in right), None)

    def _any(self, count: int) -> int:
        """A number below ``count``, from the study's seed, who answers and how many answers came before."""
        plan = self._session.plan
        purpose = f"simulated-answers-session-{plan.session}" + (f"-after-{self._before}" if self._before else "")
        self._answers += 1
        drawn = words(self._answers, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        return int(drawn[-1] % count)

    def _point(self, target: str, along: float = 0.5) -> None:
        down_ns = self._clock() + round(READING_MS * NS_PER_MS)
        up_ns = down_ns + round(HOLD_MS * NS_PER_MS)
        self._coming += [
            PointerPressed(down_ns, 0.5, 0.5, target, along),
            PointerReleased(up_ns, 0.5, 0.5, target, along),
        ]

    def _type(self, text: str) -> None:
        self._coming.append(Typed(self._clock() + round(READING_MS * NS_PER_MS), text))

    def _play(self, play: Play) -> tuple[str, float]:
        self._begin(play)
        press = self._player.press(play.world)
        return press.key, press.delay_ms

    def _begin(self, play: Play) -> None:
        if play is not self._playing:
            self._playing, self._looked = play, None
            self._player.begin(play.plan, self._session.plan.key_pool, play.world)

    def _watch(self, part: AgentPlaying, play: Play) -> None:
        """Look once at each state; whoever is no teacher leaves the agent alone, and plays where nobody else does."""
        self._begin(play)
        now = (part.who, play.steps)
        if self._looked == now:
            return
        self._looked = now
        if isinstance(self._player, Teacher):
            press = self._player.watch(play.world, watched(part, play, self._clock()))
        else:
            press = self._player.press(play.world) if part.who == "person" else None
        if press is not None:
            self._press(press.key, press.delay_ms)

    def _press(self, key: str, delay_ms: float) -> None:
        down_ns = self._clock() + round(delay_ms * NS_PER_MS)
        self._coming += [KeyDown(down_ns, key, key), KeyUp(down_ns + round(HOLD_MS * NS_PER_MS), key, key)]
        self._coming.sort(key=lambda happened: happened.t_ns)


def watched(part: AgentPlaying, play: Play, t_ns: int) -> Watched:
    """What a teacher sees of a state."""
    advised = part.advised
    action = "" if advised is None else play.world.action_names[advised.action]
    reached = play.outcome == "goal"
    return Watched(part.who, play.steps, t_ns / NS_PER_MS, action, part.hand_back_key, *part.rating_keys, reached)
