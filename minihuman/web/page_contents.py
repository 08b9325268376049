"""The contents of a page: messages that it may not have received yet, pictures, arrays, and prefetched screens.

A page that knows nothing gets new, empty contents. This module uses no socket.
"""

from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.session_copy import WorldLender
from minihuman.web import messages
from minihuman.web.computed import ComputedEpisode
from minihuman.web.message_streams import OutgoingStream
from minihuman.web.prefetch import FilmPrefetcher, LookAheadGraph, ScreenPrefetcher
from minihuman.web.screen_values import ImageCache, ImageEncoding


class PageContents:
    """Tracks the pictures and screens that a page has received or is about to receive.

    Args:
        encoding: the encoding of pictures.
        lend: lends a world with a given id and options, which may be reset; returns None if there is none to lend.
    """

    def __init__(self, encoding: ImageEncoding, lend: WorldLender) -> None:
        self.outgoing: OutgoingStream[messages.ServerMessage | messages.PictureMessage] = OutgoingStream()
        self.images = ImageCache(encoding)
        self.screen: Screen | None = None
        self.screen_name = 0
        self.screen_play: RunningEpisode | None = None  # the episode that was running when the last state was sent
        self.plays = False  # whether an episode that the page computes was running when the last state was sent
        self._state: tuple[object, ...] | None = None
        self._control: messages.AgentControl | None = None
        self._arrays: set[str] = set()
        self._screens = ScreenPrefetcher(self.images.number, lend)
        self._films = FilmPrefetcher(self.images.number)

    def send(self, message: messages.ServerMessage) -> None:
        """Send a message, after the pictures that it refers to."""
        self.send_pictures()
        self.outgoing.add(message)

    def send_pictures(self) -> None:
        """Send the pictures that are new."""
        for picture in self.images.take_new():
            self.outgoing.add(picture)

    def send_world_state(self, computed: ComputedEpisode) -> messages.WorldState:
        """Send the arrays that the page lacks for a computed episode; return the session's state in the episode."""
        for arrays in computed.arrays:
            if arrays.name not in self._arrays:
                self._arrays.add(arrays.name)
                self.outgoing.add(arrays)
        return computed.state()

    def send_control(self, control: messages.AgentControl) -> None:
        """Send the controls of an agent's episode, unless the page has them already."""
        if control != self._control:
            self._control = control
            self.outgoing.add(control)

    def record_state(self, state: tuple[object, ...]) -> bool:
        """Record the state of the episode that the page is to have; return whether the page has it already."""
        is_unchanged = state == self._state
        self._state = state
        return is_unchanged

    def send_screen(self, session: SessionMachine, screen: Screen, message: messages.ScreenMessage) -> None:
        """Send one of the session's screens, and start prefetching the screens that inputs lead to."""
        self.screen_name = message.name
        self._screens.start_from(session, message.name)
        self._films.start_from(screen, message.name)
        self.send(message)

    # Ahead

    def grow(self, session: SessionMachine, rtt_ns: int) -> bool:
        """Draw one more picture of a film, or explore one more screen ahead; return False if nothing is left."""
        frame = self._films.grow()
        if frame is not None:
            self.send(frame)
            return True
        return session.play is None and self._screens.grow(rtt_ns)

    def send_prefetched(self) -> None:
        """Send the screens that were found ahead, after their pictures."""
        prefetch = self._screens.take_new()
        self.send_pictures()
        if prefetch is not None:
            self.outgoing.add(prefetch)

    def send_scenes(self, graph: LookAheadGraph | None) -> None:
        """Send the scenes that the look-ahead graph has found; without a graph, send only new pictures."""
        update = None
        if graph is not None:
            update = graph.take_new()
        self.send_pictures()
        if update is not None:
            self.outgoing.add(update)
