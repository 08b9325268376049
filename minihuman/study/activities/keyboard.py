"""The keyboard check: every key of the pool arrives once before data are taken."""

import msgspec

from minihuman.study import texts
from minihuman.study.activities.port import Activity, Ended, Kind
from minihuman.study.events import Noted
from minihuman.study.inputs import Input, KeyDown
from minihuman.study.phases import Phase
from minihuman.study.screens import TextScreen


class KeyboardPlan(msgspec.Struct, frozen=True):
    """The keys that are asked for."""

    keys: tuple[str, ...]


class KeyboardCheck(Activity):
    """Lights each key up when it has arrived, and says what it types."""

    phase = Phase.KEYBOARD_CHECK

    def begin(self) -> None:
        """Ask for every key."""
        self._arrived: dict[str, str] = {}  # key -> symbol
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Take a key."""
        if not isinstance(happened, KeyDown):
            return
        plan: KeyboardPlan = self.part.plan
        if happened.key not in plan.keys:
            self.stage.say_key(happened, "unmapped", self.phase)
            return
        self.stage.say_key(happened, "accepted", self.phase)
        self._arrived.setdefault(happened.key, happened.symbol)
        if len(self._arrived) == len(set(plan.keys)):
            typed = ", ".join(f"{key} types {self._arrived[key]!r}" for key in plan.keys)
            self.stage.say(Noted(self.stage.now_ns, "keyboard_check", f"every key arrived: {typed}"))
            self.ended = Ended()

    def screen(self) -> TextScreen:
        """The keys, where they lie to each other."""
        return texts.keyboard_check(self.stage.words, self.part.plan.keys, frozenset(self._arrived))


KEYBOARD_CHECK = Kind("keyboard_check", KeyboardPlan, KeyboardCheck)
