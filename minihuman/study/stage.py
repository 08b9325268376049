"""What a part of a session may see of the session around it, and where it says what happened."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from minihuman.study.events import Event, KeyPressed, Verdict
from minihuman.study.inputs import KeyDown, KeyUp
from minihuman.study.plan import KeyMap, SessionPlan
from minihuman.study.play import world_calls
from minihuman.study.words import Words

if TYPE_CHECKING:
    from minihuman.worlds.adapt.world import World  # it brings Gymnasium, which whoever only reads logs does without

MakeWorld = Callable[[str, dict[str, Any]], "World"]
ENTER = ("enter", "kp_enter")


class Stage:
    """The state that outlives a part, the worlds, and the events of the input that is being dealt with."""

    def __init__(
        self,
        plan: SessionPlan,
        make_world: MakeWorld,
        picture_px: tuple[int, int] | None,
        *,
        draws_steps: bool = True,
    ) -> None:
        self.plan = plan
        self.words = Words(plan.language, plan.words, plan.fonts)
        self.picture_px = picture_px
        self.draws_steps = draws_steps
        self.now_ns = 0
        self.next_episode = plan.first_episode  # index of the episode being played or to be played next
        self.completed = 0  # episodes of this segment
        self.key_map: KeyMap | None = None  # in force
        self.points = plan.standing.points
        self.tries = dict(plan.standing.tries)
        self._make_world = make_world
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._events: list[Event] = []

    def say(self, *events: Event) -> None:
        """Say what happened, in order."""
        self._events += events

    def say_key(self, key: KeyDown | KeyUp, verdict: Verdict, phase: str, action: int | None = None) -> None:
        """Say what came of a key."""
        down, waited_ns = isinstance(key, KeyDown), self.now_ns - key.t_ns
        self.say(KeyPressed(self.now_ns, key.key, key.symbol, down, action, verdict, phase, waited_ns))

    def take_events(self) -> list[Event]:
        """What was said since the last call."""
        events, self._events = self._events, []
        return events

    def has_world(self, world_id: str, options: dict[str, Any]) -> bool:
        """Whether that world is the one that is open."""
        return self._world is not None and self._world[0] == (world_id, options)

    def world(self, world_id: str, options: dict[str, Any]) -> "World":
        """The one world that is open; another is closed first."""
        key = (world_id, options)
        if self._world is None or self._world[0] != key:
            with world_calls():
                self.close()
                self._world = (key, self._make_world(world_id, options))
        return self._world[1]

    def close(self) -> None:
        """Let go of the world."""
        if self._world:
            self._world[1].close()
            self._world = None
