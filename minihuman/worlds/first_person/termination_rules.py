"""Rules by which a step earns and ends an episode, which kernels apply; a world's ``termination_rule`` returns one."""

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.rooms import Room
from minihuman.worlds.first_person.rules import FACE, GOAL, HEALTH, PUT_NEXT, SIGN, TAKE_ALL
from minihuman.worlds.first_person.state import TerminationRule as TerminationRule


def near_goal(goal: Entity, *, forbidden: Room | None = None) -> TerminationRule:
    """End near a thing, which earns 1 down to 0.8; or in a forbidden room, for nothing."""
    edges = () if forbidden is None else forbidden.outline.edges
    return TerminationRule(GOAL, (goal,), tuple(part for edge in edges for part in (*edge.start, *edge.normal)))


def pick_up_all(count: int, *, score: str) -> TerminationRule:
    """Earn 1 for each thing picked up, which is gone then; end after so many."""
    return TerminationRule(TAKE_ALL, (), (float(count),), score)


def put_next(thing: Entity, other: Entity) -> TerminationRule:
    """End when nothing is carried and two things are near each other, which earns 1 down to 0.8."""
    return TerminationRule(PUT_NEXT, (thing, other))


def stay_alive(*, score: str, cost: float, full: float, reward: float, penalty: float) -> TerminationRule:
    """Pay for each step with health, all of which a thing that is picked up gives back; end without any.

    The thing turns up elsewhere. A step earns ``reward``, the last one ``penalty``.
    """
    return TerminationRule(HEALTH, (), (cost, full, reward, penalty), score)


def touch_right_one(things: tuple[Entity, ...], right: int) -> TerminationRule:
    """End near one of the things, the last of several counting: 1 for the right one, -1 for another; or by "done"."""
    return TerminationRule(SIGN, things, (float(right),))


def face(goal: Entity, *, reach_m: float, tolerance_m: float) -> TerminationRule:
    """End where a point so far ahead is within a tolerance of a thing, which earns 1 down to 0.8."""
    return TerminationRule(FACE, (goal,), (reach_m, tolerance_m))
