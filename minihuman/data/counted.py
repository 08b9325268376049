"""A session of which it is said what counts, and an account of what many of them left out and why."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

from minihuman.data.marks import Mark
from minihuman.data.opened import Skipped
from minihuman.data.versions import version_name
from minihuman.recorded.episode import Episode, SessionLog

Level = Literal["participant", "episode"]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """An episode, or all that a participant did in a session, that was asked for and does not count."""

    reason: str
    level: Level
    participant: str
    session: int
    episode: int | None = None  # None: the whole session
    attempt: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """A session as a selection sees it: each episode's tags, whether it is asked for, and why it does not count."""

    log: SessionLog
    tags: tuple[frozenset[str], ...]
    asked: tuple[bool, ...]
    reasons: tuple[str, ...]  # "" where nothing speaks against an episode
    wanted: bool = True  # whether the session is asked for at all; one without an episode may be
    marks: tuple[Mark, ...] = ()  # beside the log, those that were taken back among them
    session_reason: str = ""  # why the participant does not count, "" if nothing speaks against that

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Those that count, in the order played."""
        return tuple(self.log.episodes[place] for place in self.places)

    @property
    def places(self) -> tuple[int, ...]:
        """Where those that count stand among all of the session's."""
        if self.session_reason:
            return ()
        return tuple(
            place for place, (asked, why) in enumerate(zip(self.asked, self.reasons, strict=True)) if asked and not why
        )

    @property
    def counts(self) -> bool:
        """Whether the session does: with an episode that counts, or where there was none to play."""
        nothing_to_play = self.wanted and not self.session_reason and not self.log.plan.episodes
        return bool(self.places) or nothing_to_play

    @property
    def session(self) -> SessionLog:
        """The session with the episodes that count, and no others."""
        return replace(self.log, episodes=self.episodes)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """What was asked for and does not count; of a participant who does not count, nothing more is said."""
        who = self.log.plan.participant.id, self.log.plan.session
        if self.session_reason and self.wanted:
            return (LeftOut(self.session_reason, "participant", *who),)
        return tuple(
            LeftOut(why, "episode", *who, episode.number, episode.attempt)
            for episode, asked, why in zip(self.log.episodes, self.asked, self.reasons, strict=True)
            if asked and why
        )


@dataclass(slots=True)
class Account:
    """What an output is made of: how much counts, what was left out and why, what could not be read."""

    selection: str = ""  # as the command line takes it
    sessions: int = 0  # with an episode that counts, or without any to play
    episodes: int = 0  # that count
    versions: Counter[tuple[str, str]] = field(default_factory=Counter)  # study and protocol version: sessions
    left_out: Counter[tuple[Level, str]] = field(default_factory=Counter)  # by reason
    skipped: list[Skipped] = field(default_factory=list)

    def take(self, counted: Counted) -> None:
        """Take a session into the account."""
        self.episodes += len(counted.places)
        self.sessions += counted.counts
        if any(counted.asked) or counted.counts:
            self.versions[counted.log.plan.study, version_name(counted.log.plan)] += 1
        self.left_out.update((one.level, one.reason) for one in counted.left_out)

    def add(self, other: "Account") -> None:
        """Take what another has counted into the account."""
        self.sessions += other.sessions
        self.episodes += other.episodes
        self.versions.update(other.versions)
        self.left_out.update(other.left_out)
        self.skipped += other.skipped

    def lines(self) -> Iterator[str]:
        """Say it, a line a fact; the first always."""
        asked = f" ({self.selection})" if self.selection else ""
        yield f"{_many(self.episodes, 'episode')} of {_many(self.sessions, 'session')} count{asked}"
        for (level, reason), count in sorted(self.left_out.items()):
            yield f"left out: {_many(count, level)}: {reason}"
        if len(self.versions) > 1:
            told = ", ".join(
                f"{version} in {_many(count, 'session')}" for (_, version), count in sorted(self.versions.items())
            )
            yield f"several versions of the protocol: {told}; choose one with --version"
        for one in self.skipped:
            yield one.line()


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
