"""The meaning of an episode's end in environments of Gymnasium, ALE, Minigrid and Miniworld, by their documentation.

An id counts only if no other package can have registered it: alone, or after its package's name. A rule holds for the
environment as it is registered; a block whose options change rewards or ends states its own rule.
"""

from collections.abc import Iterable
from typing import NamedTuple

from minihuman.worlds.outcomes import LAST_REWARD, NO_RULE


class TableEntry(NamedTuple):
    """An outcome rule with its reason and source."""

    rule: str
    reason: str  # what the documentation says
    source: str


_GYMNASIUM = "https://gymnasium.farama.org/environments"


def _entries(path: str, rule: str, reason: str, *ids: str) -> dict[str, TableEntry]:
    """Return the same entry under each of several ids.

    Args:
        path: the page of Gymnasium's documentation that is the source, below its environments.
        rule: the outcome rule.
        reason: what the page says.
        ids: the ids of the environments.
    """
    return dict.fromkeys(ids, TableEntry(rule, reason, f"{_GYMNASIUM}/{path}/"))


def _versions(name: str, *versions: int) -> Iterable[str]:
    """Return the ids of an environment's versions, such as "Taxi-v3" and "Taxi-v4"."""
    return (f"{name}-v{version}" for version in versions)


GYMNASIUM_RULES: dict[str, TableEntry] = {
    **_entries(
        "classic_control/cart_pole",
        "return >= 500",
        "1 a step, 500 steps at most: less means that the pole fell",
        "CartPole-v1",
        "phys2d/CartPole-v1",
    ),
    **_entries(
        "classic_control/cart_pole",
        "return >= 200",
        "1 a step, 200 steps at most: less means that the pole fell",
        "CartPole-v0",
        "phys2d/CartPole-v0",
    ),
    **_entries("classic_control/mountain_car", "terminated", "terminates at the goal alone", "MountainCar-v0"),
    **_entries(
        "classic_control/mountain_car_continuous",
        "terminated",
        "terminates at the goal alone",
        "MountainCarContinuous-v0",
    ),
    **_entries("classic_control/acrobot", "terminated", "terminates at the target height alone", "Acrobot-v1"),
    **_entries(
        "classic_control/pendulum", NO_RULE, "never terminates, names no success", "Pendulum-v1", "phys2d/Pendulum-v0"
    ),
    **_entries(
        "box2d/lunar_lander",
        "return >= 200",
        "an episode is a solution if it scores at least 200 points",
        *_versions("LunarLander", 2, 3),
        *_versions("LunarLanderContinuous", 2, 3),
    ),
    **_entries("box2d/bipedal_walker", "return >= 300", "solved with 300 points", "BipedalWalker-v3"),
    **_entries("box2d/bipedal_walker", "return >= 300", "solved with 300 points", "BipedalWalkerHardcore-v3"),
    **_entries(
        "box2d/car_racing",
        "terminated and info:lap_finished",
        "terminates when the lap is finished or the car leaves the field; info says which",
        *_versions("CarRacing", 2, 3),
    ),
    **_entries(
        "toy_text/frozen_lake",
        LAST_REWARD,
        "1 at the goal, 0 in a hole",
        "FrozenLake-v1",
        "FrozenLake8x8-v1",
    ),
    **_entries(
        "toy_text/cliff_walking",
        "terminated",
        "terminates at the goal alone; the cliff leads back to the start",
        *_versions("CliffWalking", 0, 1),
        "CliffWalkingSlippery-v1",
        "tabular/CliffWalking-v0",
    ),
    **_entries(
        "toy_text/taxi", "terminated", "terminates when the passenger is dropped off alone", *_versions("Taxi", 3, 4)
    ),
    **_entries(
        "toy_text/blackjack",
        LAST_REWARD,
        "1 for a win, 0 for a draw, -1 for a loss; a draw is no success",
        "Blackjack-v1",
        "tabular/Blackjack-v0",
    ),
}

_MUJOCO = (
    *("Ant", "HalfCheetah", "Hopper", "Humanoid", "HumanoidStandup", "InvertedDoublePendulum", "InvertedPendulum"),
    *("Pusher", "Reacher", "Swimmer", "Walker2d"),
)
for _name in _MUJOCO:
    GYMNASIUM_RULES |= _entries("mujoco", NO_RULE, "names no success of an episode", *_versions(_name, 2, 3, 4, 5))

_FAMILIES = {  # by package: the prefixes of its ids, and the entry for all of them
    "ale_py": (
        ("ALE/",),
        TableEntry(NO_RULE, "ends when the game is over, won or lost", "https://ale.farama.org/environments/"),
    ),
    "minigrid": (
        ("MiniGrid-", "BabyAI-"),
        TableEntry(
            LAST_REWARD,
            "1 - 0.9 * steps / max_steps for success, 0 or less for failure",
            "https://minigrid.farama.org/environments/minigrid/",
        ),
    ),
    "miniworld": (
        ("MiniWorld-",),
        TableEntry(
            LAST_REWARD,
            "a reward above 0 ends an episode with success, 0 or less with failure",
            "https://miniworld.farama.org/environments/",
        ),
    ),
}


def find_table_entry(world_id: str) -> TableEntry | None:
    """Return the outcome rule that the table has for a world's id; None if it has none."""
    module, _, name = world_id.rpartition(":")
    package = module.partition(".")[0]
    if package in ("", "gymnasium") and name in GYMNASIUM_RULES:
        return GYMNASIUM_RULES[name]
    if package in _FAMILIES:
        return _FAMILIES[package][1]
    if package:
        return None
    return next((entry for prefixes, entry in _FAMILIES.values() if name.startswith(prefixes)), None)
