"""The effects of keys on the screens around an episode: turn a page, continue, or nothing.

This module decides what a key does; its caller turns the page, changes the phase and logs the key.
"""

from dataclasses import dataclass
from enum import StrEnum

from minihuman.activities.pages.page_reader import BACK_KEYS, FORWARD_KEYS, PageReader
from minihuman.activities.play.clocks import PhaseTimer
from minihuman.experiment.machine.activity import ENTER_KEYS
from minihuman.experiment.machine.events import KeyVerdict
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.transitions import Phase

_TEXT_PHASES = (Phase.READY, Phase.FEEDBACK)


@dataclass(frozen=True, slots=True)
class TextKeyEffect:
    """The effect of a key: its verdict for the log, the pages it turns, and whether it continues to the next phase."""

    verdict: KeyVerdict
    turns: int = 0  # pages, forward above 0
    goes_on: bool = False


class TextKeys:
    """The keys of a block's text screens.

    Args:
        reader: the pages of the instruction.
        timer: the timer of the present phase.
    """

    def __init__(self, reader: PageReader, timer: PhaseTimer) -> None:
        self._reader = reader
        self._timer = timer

    def judge(
        self, press: KeyDown, phase: StrEnum, *, now_ns: int, flip_ns: int | None, play: RunningEpisode | None
    ) -> TextKeyEffect:
        """Return the effect of a key press on a text screen.

        Args:
            press: the key press.
            phase: the block's present phase.
            now_ns: the session's time.
            flip_ns: the time at which the present text reached the display; None if it has not yet.
            play: the last or next episode, whose keys are logged as premature; None if there is none.
        """
        is_enter = press.key in ENTER_KEYS
        if phase is Phase.INSTRUCTIONS and press.key in (*FORWARD_KEYS, *BACK_KEYS):
            return self._judge_page_key(press.key)
        if phase is Phase.READY and is_enter and flip_ns is not None and press.t_ns < flip_ns:
            return TextKeyEffect("not_playing")  # pressed at the previous screen: this one was not on the display yet
        if is_enter and self._waits_for_enter(phase, now_ns):
            return TextKeyEffect("accepted", goes_on=True)
        has_action = play is not None and play.action_of(press.key) is not None
        return TextKeyEffect("not_playing" if is_enter or has_action else "unmapped")

    def _judge_page_key(self, key: str) -> TextKeyEffect:
        """Return the effect of a key that turns pages; without a page to turn to, only Enter forward is accepted."""
        turns = 1 if key in FORWARD_KEYS else -1
        has_page = self._reader.page + turns in range(self._reader.pages)
        is_enter_forward = turns > 0 and key in ENTER_KEYS
        return TextKeyEffect("accepted" if has_page or is_enter_forward else "unmapped", turns=turns)

    def _waits_for_enter(self, phase: StrEnum, now_ns: int) -> bool:
        """Return whether Enter ends a phase at this time."""
        if phase is Phase.REST:
            return self._timer.find_remaining_s(now_ns) == 0
        return phase in _TEXT_PHASES and not self._timer.is_timed(phase)
