"""Debriefing: disclose, after the last questions, whether the partners were people or agents, and offer to withdraw."""

import msgspec

from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import (
    ENTER_KEYS,
    Activity,
    ActivityKind,
    PartEnding,
)
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import Input, KeyDown
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.transitions import Phase


class DebriefPlan(msgspec.Struct, frozen=True):
    """The plan of the debriefing page, which follows the last questions."""


class DebriefActivity(Activity):
    """An activity that discloses whether the partners were people or agents, and offers to withdraw.

    If the session never played with a partner, the text leaves open which kind they were.
    """

    can_copy = True
    phase = Phase.DEBRIEFING

    def begin(self) -> None:
        """Log the phase; the page is shown until the participant presses Enter."""
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Handle an input; Enter ends the part."""
        if isinstance(happened, KeyDown):
            is_accepted = happened.key in ENTER_KEYS and not happened.repeat
            self.context.emit_key(happened, "accepted" if is_accepted else "unmapped", self.phase)
            if is_accepted:
                self.ended = PartEnding()

    def screen(self) -> Screen:
        """Build the screen that says whether the partners were people, programs or both; "either" without partners."""
        words = self.context.words
        lines = [words[f"team.was_{holder}"] for holder in ("person", "agent") if holder in self.context.partners]
        if not lines:
            lines = [words["team.was_either"]]
        body = "\n\n".join((*lines, words["team.withdraw"]))
        return screen_texts.build_notice_screen(words, words["team.debriefing"], body, words["go_on"])


DEBRIEF = ActivityKind("debrief", DebriefPlan, DebriefActivity)
