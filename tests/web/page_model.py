"""The page as a few lines of Python, on a virtual clock: it shows what it is told, and presses a script's keys."""

from collections.abc import Callable, Sequence
from typing import Any

from minihuman.experiment.machine.screens import FilmsScreen, PlayScreen
from minihuman.web import messages
from minihuman.web.session_host import SessionHost
from tests.web.page_steps import PageSteps

Press = tuple[int, str, bool]  # when, key, whether it goes down


class PageModel:
    """In front of a seat, with no line between them.

    Args:
        seat: says what is to be shown.
        script: keys in order of time.
        frame_ns: how long a flip takes.
    """

    def __init__(self, seat: SessionHost, script: Sequence[Press], *, frame_ns: int) -> None:
        self.sent: list[messages.NumberedMessage] = []
        self.told: list[messages.ServerMessage | messages.PictureMessage] = []
        self.hears = True  # and says so
        self.pictures: set[int] = set()  # that it has
        self._scenes: dict[int, set[int]] = {}  # pictures, by episode
        self._onward: list[set[int]] = []  # pictures of the screens that were sent ahead
        self._seat = seat
        self._script = list(script)
        self._frame_ns = frame_ns
        self._now_ns = 0
        self._heard = 0
        self._tick_ns: int | None = None
        self._to_show: messages.DisplayedMessage | None = None
        self._shown: tuple[object, ...] = ()  # screen, step, who steered and what flashed
        self._screen = messages.ScreenMessage(0, 0, 0, None, {"kind": ""})
        self.steps: PageSteps | None = None  # of the episode that it computes

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Until the session is over or the script is, or something holds."""
        self.say(messages.TickMessage())
        while not self._seat.over and not until():
            if self._to_show is not None:
                self._show()
            elif self._script and (self._tick_ns is None or self._script[0][0] <= max(self._tick_ns, self._now_ns)):
                t_ns, key, down = self._script.pop(0)
                self._now_ns = max(self._now_ns, t_ns)
                self.press(key, t_ns) if down else self.say(messages.KeyMessage(key, down, t_ns))
            elif self._tick_ns is not None:
                self._now_ns = max(self._now_ns, self._tick_ns)
                self.say(messages.TickMessage())
            else:
                return

    def press(self, key: str, t_ns: int) -> None:
        """Press a key, and show at once where it leads if that is computed here."""
        computes = self.steps if self._seat.session.play is not None else None
        digest = "" if computes is None else computes.press(key)
        self.say(messages.KeyMessage(key, True, t_ns, digest=digest))
        if computes is not None and digest and self._seat.session.play is not None:
            self._shown = self._screen.id, computes.step, "", ""
            self._to_show = messages.DisplayedMessage(0, 0, episode=computes.rules.episode, step=computes.step)

    def say(self, what: messages.PageMessage) -> None:
        """Number it, stamp it, have it taken, and read what comes back."""
        last_ns = self.sent[-1].at if self.sent else 0
        self.sent.append(messages.NumberedMessage(len(self.sent) + 1, max(last_ns + 1, self._now_ns), what))
        self._seat.receive(self.sent[-1].n, self.sent[-1].at, what)
        while self._seat.grow():
            pass
        self._seat.outbox.send_prefetched()
        self._read()

    def _read(self) -> None:
        for number, message in self._seat.outgoing.after(self._heard):
            self._heard = number
            self.told.append(message)
            self._keep(message)
            match message:
                case messages.ScreenMessage():
                    self._screen, self._tick_ns = message, message.tick
                    told = message.screen
                    if told["kind"] != "play":
                        self._to_show = messages.DisplayedMessage(0, 0, screen=message.id)
                    elif "picture" in told:
                        self._to_show = messages.DisplayedMessage(0, 0, episode=told["episode"], step=told["step"])
                case messages.EpisodeRules():
                    plan = self._seat.session.plan.episodes[message.episode]
                    self.steps = PageSteps(plan.world, message) if message.computed is not None else None
                case messages.StateCorrection():
                    assert self.steps is not None
                    self.steps.place(message.state)
                case messages.EpisodeState():
                    self._tick_ns = message.tick
                    seen = self._screen.id, message.step, message.who, self._flash
                    if message.step >= 0 and self._shown != seen:
                        self._shown = seen
                        self._to_show = messages.DisplayedMessage(
                            0, 0, episode=message.episode, step=message.step, node=message.node
                        )
        if self.hears and self._heard <= self._seat.outgoing.last_number:  # it may have begun anew
            self._seat.outgoing.acknowledge(self._heard)
        self._look()

    def _keep(self, message: messages.ServerMessage | messages.PictureMessage) -> None:
        """Keep pictures, and let go of them when it is told to; every picture that is named is there."""
        named: set[int] = set()
        match message:
            case messages.PictureMessage():
                self.pictures.add(message.number)
            case messages.EpisodeRules():
                self._scenes = {number: found for number, found in self._scenes.items() if number >= message.episode}
                used = _pictures_of(self._screen.screen).union(*self._onward, *self._scenes.values())
                self.pictures = {number for number in self.pictures if number >= message.keep or number in used}
            case messages.LookAheadUpdate():
                named = {picture for _, picture in message.nodes}
                self._scenes.setdefault(message.episode, set()).update(named)
            case messages.FilmFrame():
                named = {message.picture}
            case messages.ScreenMessage():
                named = _pictures_of(message.screen)
            case messages.ScreenPrefetch():
                self._onward += [_pictures_of(coming.screen) for coming in message.screens]
                named = set().union(*self._onward)
        assert named <= self.pictures, f"{message} names {named - self.pictures}, which the page does not have"

    def _look(self) -> None:
        """See what a page does by itself: the frame flashes, both films go on."""
        screen = self._seat.session.screen
        match screen:
            case PlayScreen() if self._shown and (*self._shown[:3], screen.flash) != self._shown:
                self._shown = *self._shown[:3], screen.flash
                self._to_show = messages.DisplayedMessage(0, 0, episode=screen.episode, step=screen.step)
            case FilmsScreen() if self._shown != (screen,):
                self._shown = (screen,)
                self._to_show = messages.DisplayedMessage(0, 0, screen=self._screen.id)

    @property
    def _flash(self) -> str:
        screen = self._seat.session.screen
        return screen.flash if isinstance(screen, PlayScreen) else ""

    def _show(self) -> None:
        assert self._to_show is not None
        shown, self._to_show = self._to_show, None
        shown.submit = self._now_ns
        self._now_ns += self._frame_ns
        shown.flip = self._now_ns
        self.say(shown)


def _pictures_of(screen: dict[str, Any]) -> set[int]:
    """The numbers that a screen names."""
    found = [screen.get("picture"), *(number for film in screen.get("films", ()) for number in film)]
    return {number for number in found if number is not None and number >= 0}
