"""Where Minigrid's instructions err by accident: its own verifier, ours as faithful as it, and ours repaired."""

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid.core.world_object import Ball, Box, Door, Key
from minigrid.envs.babyai.core import verifier as theirs
from minigrid.envs.babyai.core.roomgrid_level import RoomGridLevel

import minihuman  # noqa: F401
from minihuman.worlds.grid.babyai.expert import plan_instruction
from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.babyai.language import And, Before, GoTo, ObjectDescription, Open, Pickup, PutNext
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import from_text

ACTIONS = {
    letter: number for number, letter in enumerate("LRFPDTN")
}  # left, right, forward, pick up, drop, toggle, done
KEPT = "WWWWWWWWWWWW\nWW        WW\nWW  {}    WW\nWW        WW\nWW  {}    WW\nWWWWWWWWWWWW"
MAKES = {"A": Ball, "B": Box, "K": Key, "D": Door, "L": lambda colour: Door(colour, is_locked=True)}
COLOURS = {"r": "red", "g": "green", "b": "blue", "p": "purple", "y": "yellow", "-": "grey"}


class Theirs(RoomGridLevel):
    def __init__(self, diagram, instruction):
        self.diagram, self.wanted = diagram.splitlines(), instruction
        super().__init__(room_size=len(self.diagram), num_rows=1, num_cols=1)

    def gen_mission(self):
        for y, line in enumerate(self.diagram):
            for x in range(len(self.diagram)):
                kind, colour = line[2 * x : 2 * x + 2]
                if kind in ">v<^":
                    self.agent_pos, self.agent_dir = (x, y), ">v<^".index(kind)
                elif kind in MAKES:
                    self.put_obj(MAKES[kind](COLOURS[colour]), x, y)
        self.instrs = as_theirs(self.wanted)

    def validate_instrs(self, instr):
        """Diagrams are what they are."""


def as_theirs(said):
    """Our instruction as theirs."""
    if isinstance(said, And):
        return theirs.AndInstr(as_theirs(said.left), as_theirs(said.right))
    if isinstance(said, Before):
        return theirs.BeforeInstr(as_theirs(said.left), as_theirs(said.right), said.strict)
    thing = desc(said.thing)
    if isinstance(said, PutNext):
        return theirs.PutNextInstr(thing, desc(said.other), said.strict)
    if isinstance(said, GoTo):
        return theirs.GoToInstr(thing)
    return {Open: theirs.OpenInstr, Pickup: theirs.PickupInstr}[type(said)](thing, said.strict)


def desc(thing):
    return theirs.ObjDesc(thing.kind, thing.colour, thing.place)


class Ours(GridWorld):
    own_steps = False

    def __init__(self, diagram, instruction):
        self.diagram, self.wanted = diagram, instruction
        size = len(diagram.splitlines())
        super().__init__(width=size, height=size, max_steps=2 * size * size, mission=InstructionSpace())

    def layout(self, grid):
        from_text(self.diagram, grid)
        grid.instruction = self.wanted


class Repaired(Ours):
    own_steps = True


def outcome(env, letters):
    """(reward above 0, terminated) of the first step that ends, and its number; None where none does."""
    env.reset(seed=0)
    for number, letter in enumerate(letters, 1):
        _, reward, terminated, _, _ = env.step(ACTIONS[letter])
        if terminated:
            return number, reward > 0
    return None


RED_BALL, BLUE_BALL, BOX = ObjectDescription("ball", "red"), ObjectDescription("ball", "blue"), ObjectDescription("box")
AHEAD = "WWWWWWWWWW\nWW>>ArBbWW\nWW      WW\nWW    AbWW\nWWWWWWWWWW"
ONE_BALL = "WWWWWWWWWW\nWW>>Ar  WW\nWW      WW\nWW      WW\nWWWWWWWWWW"
TWO_BALLS = "WWWWWWWWWW\nWW>>Ar  WW\nWWAb    WW\nWW      WW\nWWWWWWWWWW"
TWO_DOORS = "WWWWWWDrWW\nWW    ^^Db\nWW      WW\nWW      WW\nWWWWWWWWWW"
LOCKED = "WWWWWWLrWW\nWW    ^^WW\nWW      WW\nWW      WW\nWWWWWWWWWW"
RED_BOX = "WWWWWWWWWW\nWW>>Br  WW\nWW      WW\nWW      WW\nWWWWWWWWWW"

TRACES = {
    "a door's opening is judged by what comes after it": (
        TWO_DOORS,
        Before(
            Open(ObjectDescription("door", "red"), strict=True),
            Open(ObjectDescription("door", "blue"), strict=True),
        ),
        "TRT",
        (1, False),
        (3, True),
    ),
    "strict putting fails at the pick-up it asks for": (
        TWO_BALLS, PutNext(RED_BALL, BLUE_BALL, strict=True), "P", (1, False), (1, False),
    ),
    "strict opening fails at the right door while it is locked": (
        LOCKED, Open(ObjectDescription("door", "red"), strict=True), "T", (1, False), (1, False),
    ),
    "one pick-up is two": (ONE_BALL, Before(Pickup(RED_BALL), Pickup(RED_BALL)), "PDP", (1, True), (3, True)),
    "going to where something was": (ONE_BALL, Before(Pickup(RED_BALL), GoTo(RED_BALL)), "PD", (1, True), (2, True)),
    "going to where a box was": (
        RED_BOX.replace("Br  ", "  Br"), GoTo(ObjectDescription("box", "red")), "F", (1, True), (1, True),
    ),
    "a strict failure inside and is forgotten": (
        TWO_BALLS, And(Pickup(BLUE_BALL, strict=True), GoTo(RED_BALL)), "PDRP", (4, True), (4, True),
    ),
    "a drop that fails notes places too": (ONE_BALL, Before(Pickup(RED_BALL), GoTo(RED_BALL)), "P", (1, True), None),
}  # fmt: skip


@pytest.mark.parametrize("what", TRACES)
def test_trace(what):
    diagram, said, letters, kept, repaired = TRACES[what]
    assert outcome(Theirs(diagram, said), letters) == kept
    assert outcome(Ours(diagram, said), letters) == kept
    assert outcome(Repaired(diagram, said), letters) == repaired


def test_a_box_that_was_opened_still_counts_until_something_is_dropped():
    diagram = "WWWWWWWWWW\nWWvvBr  WW\nWW      WW\nWW      WW\nWWWWWWWWWW"
    said = Before(Open(ObjectDescription("door")), GoTo(ObjectDescription("box")))
    diagram = diagram.replace("WWWWWWWWWW\nWWvv", "WWDgWWWWWW\nWWvv", 1)
    for letters, kept in (("LTRRRTR", (7, True)), ("LTRRRTDR", None)):
        assert outcome(Theirs(diagram, said), letters) == outcome(Ours(diagram, said), letters) == kept


def without_a_way(name, seeds):
    """Seeds whose mission certainly cannot be done."""
    env = gymnasium.make(f"minihuman/BabyAI-{name}").unwrapped
    found = []
    for seed in seeds:
        env.reset(seed=seed)
        if plan_instruction(env.state.row).unsolvable:
            found.append(seed)
    return found


@pytest.mark.filterwarnings("ignore:.*out of date")
def test_keys_locked_into_their_own_room():
    assert without_a_way("Unlock-v0", range(215)) == [63, 161, 165, 178, 212]
    assert without_a_way("GoToImpUnlock-v0", range(110)) == [6, 14, 35, 63, 107]
    assert without_a_way("Unlock-v1", range(215)) == []
    assert without_a_way("GoToImpUnlock-v1", range(110)) == []


@pytest.mark.filterwarnings("ignore:.*out of date")
def test_what_is_carried_from_the_start_is_seen_on_the_floor_at_first():
    name = "BabyAI-PutNextS5N2Carrying"
    theirs_, ours = gymnasium.make(f"{name}-v0").unwrapped, gymnasium.make(f"minihuman/{name}-v0").unwrapped
    repaired = gymnasium.make(f"minihuman/{name}-v1").unwrapped
    for seed in range(20):
        stale, seen = theirs_.reset(seed=seed)[0]["image"], ours.reset(seed=seed)[0]["image"]
        np.testing.assert_array_equal(seen, stale)
        assert seen[3, 6, 0] == 1  # an empty hand, as it looks
        assert ours.state.carrying != 1
        assert repaired.reset(seed=seed)[0]["image"][3, 6, 0] in (5, 6, 7)


@pytest.mark.filterwarnings("ignore:.*out of date")
@pytest.mark.parametrize("name", ["UnlockPickup", "UnlockPickupDist"])
def test_the_step_limit_that_was_forgotten(name):
    limits = []
    for world in (f"BabyAI-{name}-v0", f"minihuman/BabyAI-{name}-v0", f"minihuman/BabyAI-{name}-v1"):
        env = gymnasium.make(world).unwrapped
        env.reset(seed=0)
        limits.append(env.max_steps)
    assert limits == [72, 72, 288]
