"""Messages in a team: texts that people type to each other during play, and cells that they mark. No clock, no socket.

Typed words are in their author's log alone. Other logs hold the digests of the messages that appeared on their screens,
salted with a secret of the author's log. Withdrawing a person therefore removes their words, and `verify` can still
compare the logs.
"""

import hashlib
import math
from dataclasses import dataclass, field, replace

from minihuman.activities.questions.free_text.draft import TextDraft
from minihuman.activities.questions.question import QuestionItemSpec
from minihuman.activities.team.message_events import MessageEdited, MessageShown
from minihuman.activities.team.plan import REPORT_KEY, TeamPlan
from minihuman.activities.team.screens import PlayMessages, TeamPageFields
from minihuman.experiment.keys import key_label
from minihuman.experiment.machine.activity import ENTER_KEYS, SessionContext
from minihuman.experiment.machine.events import KeyVerdict, Noted
from minihuman.experiment.machine.inputs import MESSAGE_RULES, KeyDown, TextEdited
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import TextField
from minihuman.experiment.machine.transitions import Phase

MESSAGE_LETTERS = 200  # the longest message
N_LINES = 4  # visible messages
INTERVAL_NS = 2_000_000_000  # the shortest time between a person's messages, and how long a mark is visible


@dataclass(slots=True)
class TeamMessages:
    """The messages of a block, seen from one seat."""

    rules: TeamPlan
    context: SessionContext
    seat: int = -1
    salt: str = ""  # of the digests of this seat's messages
    sent: tuple[MessageShown, ...] = ()
    messages: dict[str, MessageShown] = field(default_factory=dict)  # shown here, by digest, in order of arrival
    draft: TextDraft | None = None  # what is being typed
    _reported: str = ""  # the digest of the words that were reported last

    @property
    def received(self) -> frozenset[str]:
        """Return the digests of the messages that need not be sent again.

        A session that was resumed from its log lacks the words of other seats, so their digests are not among these.
        """
        return frozenset(digest for digest, message in self.messages.items() if message.text or message.cell)

    @property
    def marks(self) -> list[MessageShown]:
        """Return the messages with a marked cell that are visible now."""
        visible_since_ns = self.context.now_ns - INTERVAL_NS
        return [message for message in self.messages.values() if message.cell and message.t_ns > visible_since_ns]

    def take_key(self, press: KeyDown, play: RunningEpisode) -> bool:
        """Handle a key press if it concerns messages; return whether it did."""
        if self.draft is None and (press.repeat or press.key not in self._keys):
            return False
        verdict = self._judge_key(press)
        self.context.emit_key(press, verdict, Phase.PLAYING)
        if self.draft is not None and verdict != "accepted":
            self._edit_by_key(self.draft, press)
        elif self.draft is not None:
            self._finish_draft(self.draft, play)
        elif press.key in ENTER_KEYS:
            self.draft = self._make_draft()
        elif press.key == self.rules.ping:
            self._mark_cell_ahead(play)
        else:
            self._report_latest()
        return True

    @property
    def _keys(self) -> tuple[object, ...]:
        """Return the keys that have an effect while no message is being typed."""
        if self.rules.chat:
            return (*ENTER_KEYS, REPORT_KEY, self.rules.ping)
        return (self.rules.ping,)

    def _judge_key(self, press: KeyDown) -> KeyVerdict:
        """Return the verdict, for the log, on a key press that concerns messages."""
        if press.repeat:
            return "repeat"
        if press.key in ENTER_KEYS or self.draft is None:
            return "accepted"
        return "typing"

    @staticmethod
    def _edit_by_key(draft: TextDraft, press: KeyDown) -> None:
        """Apply a key press to a draft, unless a native text field of the window edits it."""
        if not draft.has_native_field:
            draft.key(press)

    def type_text(self, text: str) -> None:
        """Insert characters into the draft, if there is one that no native text field of the window edits."""
        if self.draft is not None and not self.draft.has_native_field:
            self.draft.type_text(text)

    def edit_text(self, edited: TextEdited) -> None:
        """Replace the draft's text by the whole text of the native field and log it; ignore an earlier message's."""
        if self.draft is None or edited.field not in ("", self.draft.question.name):
            return
        if not self.draft.put_text(edited.text):
            return
        now_ns = self.context.now_ns
        began_ns = min(edited.began_ns or now_ns, now_ns)
        self.context.emit(MessageEdited(now_ns, edited.text, edited.changes, edited.keys, now_ns - began_ns))

    def _make_draft(self) -> TextDraft:
        """Return an empty draft for the next message, with a field name that no earlier message has."""
        name = f"message-{len(self.sent) + 1}"
        words = self.context.words
        question = QuestionItemSpec(name, "text", "", longest=MESSAGE_LETTERS)
        draft = TextDraft(question, None, rtl=words.rtl, language=words.language)
        draft.has_native_field = self.context.facts.get("message_rules", "1") == MESSAGE_RULES
        draft.limit_note = words["team.too_long"]
        return draft

    def _finish_draft(self, draft: TextDraft, play: RunningEpisode) -> None:
        """Send the draft's text and close the draft; an empty draft is only closed.

        The draft stays open if its text is too long, or follows the last message too soon.
        """
        is_done = not draft.value
        if not is_done and draft.error is None:
            is_done = self._send(play, draft.display_text, ())
        if is_done:
            self.draft = None

    def _mark_cell_ahead(self, play: RunningEpisode) -> None:
        """Send a mark of the cell in front of the participant's body, if the world knows the body's pose."""
        pose = play.world.pose()
        if pose is not None:
            # z grows down the map, so a positive yaw turns towards smaller z
            cell_x = round(pose.x + math.cos(pose.yaw_rad))
            cell_z = round(pose.z - math.sin(pose.yaw_rad))
            self._send(play, "", (cell_x, cell_z))

    def _report_latest(self) -> None:
        """Log that the participant reports the latest words of another seat; do nothing if there are none."""
        messages = [message for message in self.messages.values() if message.seat != self.seat and not message.cell]
        if messages:
            message = messages[-1]
            self._reported = message.digest
            text = f"message {message.digest} of seat {message.seat}"
            self.context.emit(Noted(self.context.now_ns, "report", text))

    def _send(self, play: RunningEpisode, text: str, cell: tuple[float, ...]) -> bool:
        """Send a message and return True, or return False if the last one was sent too recently.

        A message has words, or a cell (x, z) that is marked; the other is empty.
        """
        now_ns = self.context.now_ns
        if self.sent and now_ns < self.sent[-1].t_ns + INTERVAL_NS:
            return False
        digest = hashlib.blake2b(
            f"{self.seat} {now_ns} {text} {cell}".encode(), key=self.salt.encode(), digest_size=16
        ).hexdigest()
        self.sent += (MessageShown(now_ns, play.plan.episode, play.steps, self.seat, text, cell, digest),)
        self.show(self.sent[-1], play)
        return True

    def show(self, message: MessageShown, play: RunningEpisode) -> None:
        """Show a message and log that it appeared; other seats' words are left out of the log.

        A message that was shown before is only restored with its words, without a log entry.
        """
        shown_message = replace(message, t_ns=self.context.now_ns, episode=play.plan.episode, step=play.steps)
        if message.digest not in self.messages:
            self.context.emit(shown_message if message.seat == self.seat else replace(shown_message, text=""))
        self.messages[message.digest] = shown_message

    def look(self, play: RunningEpisode | None) -> PlayMessages | None:
        """Return the messages as the page displays them; None if the block has neither chat nor marks."""
        hints = self._key_hints
        if not hints:
            return None
        marks = self.marks
        cells = []
        for mark in marks:
            x, z = mark.cell
            cells.append((x, z, mark.seat == self.seat))
        text_messages = [message for message in self.messages.values() if not message.cell][-N_LINES:]
        return {
            "new_entry": self._new_entry,
            "hint": "   ".join(hints),
            "lines": [(self._name_author(message.seat), self._format_text(message)) for message in text_messages],
            "entry": None if self.draft is None else self.draft.widget(),
            "cells": cells,
            "bounds": play.world.unwrapped.map().bounds if play and marks else (),
        }

    @property
    def _new_entry(self) -> TextField | None:
        """Return the empty field of the next message; None if the block has no chat."""
        if not self.rules.chat:
            return None
        return self._make_draft().widget()

    def list_page_fields(self, play: RunningEpisode | None) -> TeamPageFields:
        """Return the fields that messages add to the page's screen of play."""
        messages = self.look(play)
        return {"messages": messages} if messages else {}

    @property
    def _key_hints(self) -> list[str]:
        """Return the lines that tell the participant which keys write a message and mark a cell."""
        words = self.context.words
        hints = [words["team.chat_keys"]] if self.rules.chat else []
        if self.rules.ping:
            hints.append(words.fill("team.ping_key", ping=key_label(self.rules.ping)))
        return hints

    def _name_author(self, seat: int) -> str:
        """Return the displayed name of a message's author: "you", the seat's role, or the person's number."""
        words = self.context.words
        if seat == self.seat:
            return words["team.you"]
        if self.rules.roles:
            return self.rules.roles[seat]
        return words.fill("team.person", number=seat + 1)

    def _format_text(self, message: MessageShown) -> str:
        """Return a message's words as displayed, with a note if they were reported; "…" if they were not recovered."""
        text = message.text or "…"
        if message.digest == self._reported:
            return f"{text} ({self.context.words['team.reported']})"
        return text
