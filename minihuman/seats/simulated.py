"""A window with nobody in front of it: a player presses the keys, on a virtual clock, and no picture is drawn."""

from collections.abc import Callable

from minihuman.players.port import Player
from minihuman.study.activities.questions import Questions
from minihuman.study.chance import words
from minihuman.study.inputs import Input, KeyDown, KeyUp, PointerPressed, PointerReleased, Shown, Typed
from minihuman.study.screens import (
    Choices,
    Entry,
    PageScreen,
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
HOLD_MS = 90.0


class SimulatedWindow(Window):
    """Hands the session what a player presses; texts are read in a second and answered as they ask.

    Args:
        player: presses the keys while playing.
        session: the session it sits in, for the world that the player looks at.
        clock: the session's; waiting moves it.
        at_rest: called between episodes, when nothing is urgent.
    """

    def __init__(
        self, player: Player, session: Session, clock: VirtualClock, *, at_rest: Callable[[], None] = lambda: None
    ) -> None:
        self._player = player
        self._session = session
        self._clock = clock
        self._at_rest = at_rest
        self._screen: Screen = TextScreen("", "", "")
        self._episode = -1
        self._answers = 0  # given so far
        self._coming: list[Input] = []  # in order of time

    def show(self, screen: Screen) -> Shown:
        """Look at a screen; it is there one frame later."""
        self._screen = screen
        submit_ns = self._clock()
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
            self._clock.advance_to(until_ns)
            return []
        happened = self._coming.pop(0)
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
            case PlayScreen() if self._session.play is not None:  # else the last picture is held
                self._press(*self._play())
            case PageScreen():
                self._press("enter", READING_MS)
            case QuestionScreen():
                self._answer(self._screen)
            case TextScreen(keys=keys) if missing := [key for key, pressed in keys if not pressed]:
                self._press(missing[0], READING_MS)
            case TextScreen() if self._session.next_tick_ns is None:  # else a rest is running: nothing to press yet
                self._press("enter", READING_MS)

    def _answer(self, question: QuestionScreen) -> None:
        """Any answer, each as likely as another: nothing is known of what these people think. They have read, though:
        where there is a right answer, nine in ten give it.
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
        if not isinstance(part, Questions) or part.asked.right is None or self._any(10) == 0:
            return None
        right = part.asked.right if isinstance(part.asked.right, tuple) else (part.asked.right,)
        return next((place for place, code in enumerate(part.asked.all_codes) if code in right), None)

    def _any(self, count: int) -> int:
        """A number below ``count``, from the study's seed, who answers and how many answers came before."""
        plan = self._session.plan
        purpose = f"simulated-answers-session-{plan.session}"
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

    def _play(self) -> tuple[str, float]:
        play = self._session.play
        assert play is not None
        if play.plan.episode != self._episode:
            self._episode = play.plan.episode
            self._player.begin(play.plan, self._session.plan.key_pool, play.world)
        press = self._player.press(play.world)
        return press.key, press.delay_ms

    def _press(self, key: str, delay_ms: float) -> None:
        down_ns = self._clock() + round(delay_ms * NS_PER_MS)
        self._coming += [KeyDown(down_ns, key, key), KeyUp(down_ns + round(HOLD_MS * NS_PER_MS), key, key)]
        self._coming.sort(key=lambda happened: happened.t_ns)
