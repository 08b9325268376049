"""The steps of the episode that is played: which scene each led to, and what the page says that it showed of them.

No socket, no clock.
"""

from collections.abc import Iterable, Mapping

from minihuman.experiment.machine.events import EpisodeBeginning, EpisodeStep, Event
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.web.messages import DisplayedMessage

UNKNOWN_SCENE = -1


class EpisodeSteps:
    """Keeps the scenes of the latest episode's steps.

    Args:
        logged: the events of the log that a session is resumed from.
    """

    def __init__(self, logged: Iterable[Event]) -> None:
        self.episode = -1  # whose steps these are
        self._scenes: list[int] = []  # the names of those that its steps led to
        self._play: RunningEpisode | None = None  # begun here, so that the page knows its rules
        self._early: DisplayedMessage | None = None  # a picture that was shown, until its step is closed
        for event in logged:
            match event:
                case EpisodeBeginning():
                    self.episode, step = event.begins_at
                    self._scenes = [UNKNOWN_SCENE] * (step + 1)
                case EpisodeStep():
                    self._scenes.append(UNKNOWN_SCENE)

    def begin(self, play: RunningEpisode) -> None:
        """Begin with an episode, of which the page knows no steps yet."""
        self._play = play
        self._early = None

    @property
    def _is_joint(self) -> bool:
        """Whether the page shows the own action before the others'."""
        return self._play is not None and self._play.is_joint

    def place(self, play: RunningEpisode, scene: int) -> None:
        """Set the scene that an episode is in now; those before it are unknown."""
        self.episode = play.plan.episode
        self._scenes = [*[UNKNOWN_SCENE] * play.steps, scene]

    def append(self, scene: int) -> None:
        """Add a step's scene."""
        self._scenes.append(scene)

    def find_scene(self, step: int) -> int:
        """Return the scene that a step led to, if it was made and is known."""
        if 0 <= step < len(self._scenes):
            return self._scenes[step]
        return UNKNOWN_SCENE

    # What the page showed

    def knows(self, message: DisplayedMessage) -> bool:
        """Whether a picture that was shown is one of the present episode's steps."""
        return message.episode == self.episode and message.step < len(self._scenes)

    def keep_early(self, message: DisplayedMessage) -> None:
        """Keep word of a picture that was shown before its joint step was closed."""
        if self._is_joint and (message.episode, message.step) == (self.episode, len(self._scenes)):
            self._early = message

    def take_early(self) -> DisplayedMessage | None:
        """Return what was kept, once its step is closed."""
        early = self._early
        if early is None or not self.knows(early):
            return None
        self._early = None
        return early

    def find_corrected(self, message: DisplayedMessage, pictures: Mapping[int, int]) -> RunningEpisode | None:
        """Return the episode if a joint step of it came out otherwise than a picture had shown it.

        Args:
            message: what was shown.
            pictures: the numbers of the scenes' pictures.
        """
        scene = self._scenes[message.step]
        if not self._is_joint or scene not in pictures:
            return None
        if pictures.get(message.node, -1) in (-1, pictures[scene]):
            return None
        return self._play

    def difference(self, message: DisplayedMessage) -> str:
        """Return how a step's picture was another than the session's; "" where it was the same."""
        scene = self._scenes[message.step]
        if self._is_joint or not scene >= 0 <= message.node or scene == message.node:
            return ""
        return f"step {message.step} of episode {message.episode + 1} was shown as scene {message.node}, it is {scene}"
