"""Consent first: events wait in memory until a participant has agreed; only then is there a file.

Somebody who declines, closes the window or stays away before that leaves nothing behind. Nor does anybody whose group
is not drawn yet: their session says nothing before, and the file begins with the plan.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from minihuman.log.record.recorder import Recorder
from minihuman.study.events import Event, Noted
from minihuman.study.parts import asks_for_consent_first
from minihuman.study.plan import SessionPlan
from minihuman.study.undrawn import is_undrawn


class HeldRecorder(Recorder):
    """Opens a recorder at the agreement and hands it all that came before, with the times that it had.

    A session that does not begin with a consent, or that goes on after one, is recorded from its first event.

    Args:
        plan: what is about to be played.
        open_recorder: makes the recorder; called once, or never.

    Raises:
        LogError: as ``open_recorder`` does, where nothing is to be waited for.
    """

    def __init__(self, plan: SessionPlan, open_recorder: Callable[[], Recorder]) -> None:
        self._open_recorder = open_recorder
        self._waiting: list[Sequence[Event]] = []  # a write each
        self._closed = False
        self._asks = asks_for_consent_first(plan)
        self._recorder = None if self._asks or is_undrawn(plan) else open_recorder()

    @property
    def opened(self) -> bool:
        """Whether anything is recorded."""
        return self._recorder is not None

    def write(self, events: Sequence[Event]) -> None:
        """Take the events; with those that waited, if the consent is among them.

        Raises:
            LogError: as the recorder does; also if it cannot be opened.
        """
        if self._recorder is None and not self._closed:
            self._waiting.append(events)
            agreed = any(isinstance(event, Noted) and event.kind == "consent" for event in events)
            if not events or (self._asks and not agreed):
                return
            self._recorder = self._open_recorder()
            waiting, self._waiting = self._waiting, []
            for events in waiting:
                self._recorder.write(events)
        elif self._recorder is not None:
            self._recorder.write(events)

    def begin(self, events: Sequence[Event]) -> None:
        """Take the events, and if there is a recorder leave it to it when to wait.

        Raises:
            LogError: as ``write``.
        """
        (self.write if self._recorder is None else self._recorder.begin)(events)

    def settle(self) -> None:
        """Wait as the recorder does, if there is one.

        Raises:
            LogError: as the recorder does.
        """
        if self._recorder is not None:
            self._recorder.settle()

    @property
    def durable_steps(self) -> int:
        """As the recorder says; 0 before there is one."""
        return 0 if self._recorder is None else self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """As the recorder says: each write that waited is one of its own; 0 before there is one."""
        return 0 if self._recorder is None else self._recorder.durable_writes

    def close(self) -> Path | None:
        """Finish the log, if there is one; else forget what waited."""
        self._closed = True
        self._waiting = []
        return None if self._recorder is None else self._recorder.close()
