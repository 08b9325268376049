"""Steps of the current episode: the scene that each step led to, and what the page reports to have shown of it.

This module uses no socket and no clock.
"""

from collections.abc import Iterable, Mapping

from minihuman.experiment.machine.events import EpisodeBeginning, EpisodeStep, Event
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.web.messages import DisplayedMessage

UNKNOWN_SCENE = -1


class EpisodeSteps:
    """Keeps the scene after each step of the latest episode.

    Args:
        logged: the events of the log that the session is resumed from.
    """

    def __init__(self, logged: Iterable[Event]) -> None:
        self.episode = -1  # the latest episode's number
        self._scenes: list[int] = []  # the names of the scenes after each of its steps
        self._play: RunningEpisode | None = None  # the episode whose rules the page has
        self._early: DisplayedMessage | None = None  # the report of a picture whose step is not closed yet
        for event in logged:
            match event:
                case EpisodeBeginning():
                    self.episode, step = event.begins_at
                    self._scenes = [UNKNOWN_SCENE] * (step + 1)
                case EpisodeStep():
                    self._scenes.append(UNKNOWN_SCENE)

    def begin(self, play: RunningEpisode) -> None:
        """Begin an episode whose rules are sent to the page; no picture of it has been reported yet."""
        self._play = play
        self._early = None

    @property
    def _is_joint(self) -> bool:
        """Return whether the page shows the participant's own action before the others' actions are known."""
        return self._play is not None and self._play.is_joint

    def place(self, play: RunningEpisode, scene: int) -> None:
        """Record the name of an episode's current scene, and mark all earlier scenes as unknown."""
        self.episode = play.plan.episode
        self._scenes = [*[UNKNOWN_SCENE] * play.steps, scene]

    def append(self, scene: int) -> None:
        """Add the name of the scene that the next step led to."""
        self._scenes.append(scene)

    def find_scene(self, step: int) -> int:
        """Return the name of the scene after a step; UNKNOWN_SCENE if the step was not made or its scene is unknown."""
        if 0 <= step < len(self._scenes):
            return self._scenes[step]
        return UNKNOWN_SCENE

    # What the page showed

    def knows(self, message: DisplayedMessage) -> bool:
        """Return whether a displayed picture shows a step of the latest episode that was made already."""
        return message.episode == self.episode and message.step < len(self._scenes)

    def keep_early(self, message: DisplayedMessage) -> None:
        """Keep a message about the picture of the next step, if it is a joint step, which is not closed yet."""
        if self._is_joint and (message.episode, message.step) == (self.episode, len(self._scenes)):
            self._early = message

    def take_early(self) -> DisplayedMessage | None:
        """Return and discard the message kept by ``keep_early`` once its step is closed; return None before."""
        early = self._early
        if early is None or not self.knows(early):
            return None
        self._early = None
        return early

    def find_corrected(self, message: DisplayedMessage, pictures: Mapping[int, int]) -> RunningEpisode | None:
        """Return the running episode if its joint step differs from the picture shown for it; otherwise None.

        Args:
            message: the message about the displayed picture, which ``knows`` accepts.
            pictures: the number of each scene's picture, by the scene's name.
        """
        scene = self._scenes[message.step]
        if not self._is_joint or scene not in pictures or message.node not in pictures:
            return None
        if pictures[message.node] == pictures[scene]:
            return None
        return self._play

    def describe_difference(self, message: DisplayedMessage) -> str:
        """Return how the scene displayed for a step differs from the session's; ``knows`` must accept the message.

        The text is "" if the scenes do not differ, if one of them is unknown, or in a joint episode.
        """
        scene = self._scenes[message.step]
        is_unknown = scene < 0 or message.node < 0
        if self._is_joint or is_unknown or scene == message.node:
            return ""
        return f"step {message.step} of episode {message.episode + 1} was shown as scene {message.node}, it is {scene}"
