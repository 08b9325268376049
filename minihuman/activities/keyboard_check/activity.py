"""Keyboard check: the participant must press every key of the pool once before data are recorded."""

from minihuman.activities.keyboard_check.early_plans import find_early_check
from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.activities.keyboard_check.screens import build_keyboard_check_screen
from minihuman.experiment.machine.activity import Activity, ActivityKind, PartEnding, needs_no_server
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import Input, KeyDown
from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.machine.transitions import Phase


class KeyboardCheckActivity(Activity):
    """An activity that shows which keys of the pool have been pressed, and what each key types."""

    phase = Phase.KEYBOARD_CHECK
    can_copy = True

    def begin(self) -> None:
        """Begin the check with no key pressed yet, and log the phase."""
        self._arrived: dict[str, str] = {}  # key -> symbol
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Handle an input: log a key press, and end the part once every key of the pool has been pressed."""
        if not isinstance(happened, KeyDown):
            return
        plan: KeyboardCheckPlan = self.part.plan
        if happened.key not in plan.keys:
            self.context.emit_key(happened, "unmapped", self.phase)
            return
        self.context.emit_key(happened, "accepted", self.phase)
        self._arrived.setdefault(happened.key, happened.symbol)
        if len(self._arrived) == len(set(plan.keys)):
            symbols = ", ".join(f"{key} types {self._arrived[key]!r}" for key in plan.keys)
            self.context.emit(Noted(self.context.now_ns, "keyboard_check", f"every key arrived: {symbols}"))
            self.ended = PartEnding()

    def screen(self) -> TextScreen:
        """Build the screen of the keys, arranged as on the keyboard."""
        return build_keyboard_check_screen(self.context.words, self.part.plan.keys, frozenset(self._arrived))


KEYBOARD_CHECK = ActivityKind(
    "keyboard_check",
    KeyboardCheckPlan,
    KeyboardCheckActivity,
    find_early_parts=find_early_check,
    find_server_needs=needs_no_server,
    is_for_players=True,
)
