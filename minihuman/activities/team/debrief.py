"""Debriefing: tell, after the last questions, what the partners were, and offer to withdraw."""

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
    """``plan`` of the page that tells, after the last questions, what the partners were."""


class DebriefActivity(Activity):
    """Tells what the partners were, and offers to withdraw; nothing where the session was in no team."""

    can_copy = True
    phase = Phase.DEBRIEFING

    def begin(self) -> None:
        """Show the page."""
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    def receive(self, happened: Input) -> None:
        """Take an input: Enter goes on."""
        if isinstance(happened, KeyDown):
            goes_on = happened.key in ENTER_KEYS and not happened.repeat
            self.context.emit_key(happened, "accepted" if goes_on else "unmapped", self.phase)
            if goes_on:
                self.ended = PartEnding()

    def screen(self) -> Screen:
        """What the partners were."""
        words = self.context.words
        were = [words[f"team.was_{holder}"] for holder in ("person", "agent") if holder in self.context.partners]
        body = "\n\n".join((*(were or [words["team.was_either"]]), words["team.withdraw"]))
        return screen_texts.build_notice_screen(words, words["team.debriefing"], body, words["go_on"])


DEBRIEF = ActivityKind("debrief", DebriefPlan, DebriefActivity)
