"""Contract test of simulated participants: valid keys, increasing times, and the same keys from the same random
stream.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from minihuman.display.windows.window import VirtualClock
from minihuman.errors import PlayerFailedError, SimulationError
from minihuman.experiment.keys import BUTTON_NAMES
from minihuman.experiment.machine.events import KeyPressed, SessionEnded
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import SimulatedWindow
from minihuman.simulation.participant import KeyPress, SimulatedParticipant, make_participant
from minihuman.testing.checks import ContractError, build_short_study, require
from minihuman.worlds.adapters.world import World

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
MAX_WAIT_MS = 60_000.0
Keys = list[tuple[int, str]]  # when, ns, and which


def check_participant(
    make: str | Callable[[np.random.Generator], SimulatedParticipant],
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
        SimulationError: if it cannot play this world.
    """
    first, again = (_record_keys(_make(make, seed), world, options or {}, episodes, max_steps) for _ in range(2))
    require(bool(first), "the player pressed no key")
    require(first == again, "from the same chance the player pressed other keys; it draws from something else than rng")


def _make(make: str | Callable[[np.random.Generator], SimulatedParticipant], seed: int) -> SimulatedParticipant:
    rng = np.random.default_rng(seed)
    player = make_participant(make, rng) if isinstance(make, str) else make(rng)
    require(
        isinstance(player, SimulatedParticipant),
        f"{type(player).__name__} is not a minihuman.simulation.participant.SimulatedParticipant",
    )
    return player


def _record_keys(
    player: SimulatedParticipant, world: str, options: dict[str, Any], episodes: int, max_steps: int
) -> Keys:
    protocol = build_short_study(world, options, episodes=episodes, max_steps=max_steps)
    clock, recorder = VirtualClock(), MemoryRecorder()
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    try:
        run_session(session, SimulatedWindow(_WatchedParticipant(player), session, clock), recorder, clock)
    except PlayerFailedError as error:
        if isinstance(error.__cause__, ContractError | SimulationError):
            raise error.__cause__ from None
        require(False, f"the player failed ({error}); in a study its session would end as player_failed")
    if session.failure is not None:
        raise session.failure
    ends = [event for event in recorder.events if isinstance(event, SessionEnded)]
    require(bool(ends) and ends[-1].reason == "complete", "the session did not come to its end with this player")
    return [(event.t_ns, event.key) for event in recorder.events if isinstance(event, KeyPressed)]


class _WatchedParticipant(SimulatedParticipant):
    """A player that is watched: it looks at the world and changes nothing in it."""

    def __init__(self, player: SimulatedParticipant) -> None:
        self._player = player

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Let it begin."""
        before = world.state_hash()
        self._player.begin(plan, pool, world)
        require(world.state_hash() == before, "begin() changed the world; a player only looks at it")

    def press(self, world: World) -> KeyPress:
        """Let it press, and look at the key."""
        before = world.state_hash()
        press = self._player.press(world)
        require(press is not None, "press() gave no answer; in a study its session would end as player_failed")
        require(isinstance(press, KeyPress), f"press() gave a {type(press).__name__}, not a KeyPress")
        assert press is not None
        require(world.state_hash() == before, "press() changed the world; a player only looks at it")
        require(press.key in BUTTON_NAMES, f"press() gave the key {press.key!r}, which no keyboard has")
        in_time = isinstance(press.delay_ms, int | float) and math.isfinite(press.delay_ms)
        require(
            in_time and 0 <= press.delay_ms <= MAX_WAIT_MS,
            f"press() waits {press.delay_ms!r} ms; a delay is 0 to {MAX_WAIT_MS:.0f}",
        )
        return press
