"""What every player promises: keys that there are, in a time that passes; the same again from the same chance."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from minihuman.log.record.recorder import MemoryRecorder
from minihuman.players.choose import make_player
from minihuman.players.port import Player, Press
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.events import KeyPressed, SessionEnded
from minihuman.study.expand import enrol, expand
from minihuman.study.keys import KEY_NAMES
from minihuman.study.plan import EpisodePlan
from minihuman.study.session import Session
from minihuman.testing.kept import promise
from minihuman.testing.session import short_study
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
MOST_WAIT_MS = 60_000.0
Keys = list[tuple[int, str]]  # when, ns, and which


def check_player(
    make: str | Callable[[np.random.Generator], Player],
    world: str = WORLD,
    options: dict[str, Any] | None = None,
    *,
    episodes: int = 2,
    max_steps: int = 40,
    seed: int = 0,
) -> None:
    """Seat a player in a short session, twice from the same chance, and watch what it does.

    Args:
        make: the player as `minihuman simulate` is given it ("human-like:lapse=0.1"), or what makes one from a stream
            of chance.
        world: the world it plays, an id.
        options: of the world.
        episodes: that it plays.
        max_steps: of each.
        seed: of its chance.

    Raises:
        ContractError: if a promise is not kept; it says which.
        PlayerError: if it cannot play this world.
    """
    first, again = (_keys(_made(make, seed), world, options or {}, episodes, max_steps) for _ in range(2))
    promise(bool(first), "the player pressed no key")
    promise(first == again, "from the same chance the player pressed other keys; it draws from something else than rng")


def _made(make: str | Callable[[np.random.Generator], Player], seed: int) -> Player:
    rng = np.random.default_rng(seed)
    player = make_player(make, rng) if isinstance(make, str) else make(rng)
    promise(isinstance(player, Player), f"{type(player).__name__} is no minihuman.players.port.Player")
    return player


def _keys(player: Player, world: str, options: dict[str, Any], episodes: int, max_steps: int) -> Keys:
    protocol = short_study(world, options, episodes=episodes, max_steps=max_steps)
    clock, recorder = VirtualClock(), MemoryRecorder()
    session = Session(expand(protocol, enrol(protocol, 0)), World, {}, picture_px=None)
    run_session(session, SimulatedWindow(_Watched(player), session, clock), recorder, clock)
    if session.failure is not None:
        raise session.failure
    ends = [event for event in recorder.events if isinstance(event, SessionEnded)]
    promise(bool(ends) and ends[-1].reason == "complete", "the session did not come to its end with this player")
    return [(event.t_ns, event.key) for event in recorder.events if isinstance(event, KeyPressed)]


class _Watched(Player):
    """A player that is watched: it looks at the world and changes nothing in it."""

    def __init__(self, player: Player) -> None:
        self._player = player

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Let it begin."""
        before = world.state_hash()
        self._player.begin(plan, pool, world)
        promise(world.state_hash() == before, "begin() changed the world; a player only looks at it")

    def press(self, world: World) -> Press:
        """Let it press, and look at the key."""
        before = world.state_hash()
        press = self._player.press(world)
        promise(isinstance(press, Press), f"press() gave a {type(press).__name__}, not a Press")
        promise(world.state_hash() == before, "press() changed the world; a player only looks at it")
        promise(press.key in KEY_NAMES, f"press() gave the key {press.key!r}, which no keyboard has")
        in_time = isinstance(press.delay_ms, int | float) and math.isfinite(press.delay_ms)
        promise(
            in_time and 0 <= press.delay_ms <= MOST_WAIT_MS,
            f"press() waits {press.delay_ms!r} ms; a delay is 0 to {MOST_WAIT_MS:.0f}",
        )
        return press
