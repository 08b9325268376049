"""Rules for the reward of a step and the end of an episode, which kernels apply.

A world's ``termination_rule`` returns one of them.
"""

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.rooms import Room
from minihuman.worlds.first_person.rules import FACE, GOAL, HEALTH, PUT_NEXT, SIGN, TAKE_ALL
from minihuman.worlds.first_person.state import TerminationRule as TerminationRule


def near_goal(goal: Entity, *, forbidden: Room | None = None) -> TerminationRule:
    """Return the rule that ends an episode near an entity, paying 1 down to 0.8, or in a forbidden room, paying 0."""
    edges = () if forbidden is None else forbidden.outline.edges
    return TerminationRule(GOAL, (goal,), tuple(part for edge in edges for part in (*edge.start, *edge.normal)))


def pick_up_all(count: int, *, score: str) -> TerminationRule:
    """Return the rule that pays 1 for each entity picked up, which disappears, and ends after ``count`` of them.

    ``score`` is the name of the world's attribute that counts them.
    """
    return TerminationRule(TAKE_ALL, (), (float(count),), score)


def put_next(thing: Entity, other: Entity) -> TerminationRule:
    """Return the rule that pays 1 down to 0.8 and ends an episode when two entities are near and nothing is carried."""
    return TerminationRule(PUT_NEXT, (thing, other))


def stay_alive(*, score: str, cost: float, full: float, reward: float, penalty: float) -> TerminationRule:
    """Return the rule by which each step costs health, and an episode ends without any left.

    An entity that is picked up restores full health and reappears elsewhere.

    Args:
        score: the name of the world's attribute that holds the health
        cost: the health that a step costs
        full: the full health
        reward: the reward of a step after which health is left
        penalty: the reward of the last step
    """
    return TerminationRule(HEALTH, (), (cost, full, reward, penalty), score)


def touch_right_one(things: tuple[Entity, ...], right: int) -> TerminationRule:
    """Return the rule that ends an episode near one of the entities, paying 1 for the right one and -1 for another.

    ``right`` is the right one's index in ``things``. If several are near, the last one counts. The action "done" also
    ends the episode.
    """
    return TerminationRule(SIGN, things, (float(right),))


def face(goal: Entity, *, reach_m: float, tolerance_m: float) -> TerminationRule:
    """Return the rule that pays 1 down to 0.8 and ends an episode when the agent faces an entity.

    It does if the point ``reach_m`` ahead of the agent is at most ``tolerance_m`` from the entity's middle.
    """
    return TerminationRule(FACE, (goal,), (reach_m, tolerance_m))
