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
            goes_on = happened.key in ENTER_KEYS and not happened.repeat
            self.context.emit_key(happened, "accepted" if goes_on else "unmapped", self.phase)
            if goes_on:
                self.ended = PartEnding()

    def screen(self) -> Screen:
        """Build the screen that says whether each partner was a person or a program."""
        words = self.context.words
        were = [words[f"team.was_{holder}"] for holder in ("person", "agent") if holder in self.context.partners]
        body = "\n\n".join((*(were or [words["team.was_either"]]), words["team.withdraw"]))
        return screen_texts.build_notice_screen(words, words["team.debriefing"], body, words["go_on"])


DEBRIEF = ActivityKind("debrief", DebriefPlan, DebriefActivity)
