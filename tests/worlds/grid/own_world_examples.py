"""Grid worlds as researchers write them: the page's examples, and others. Not every one of them can be translated."""

from minihuman.worlds.grid.core.cells import EMPTY, kind_of
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import from_text
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.object_kinds import ObjectKind, ball, door, goal, key
from minihuman.worlds.grid.own import Bool, Float, Int, IntArray, IntTuple
from minihuman.worlds.grid.team_grid import TeamGrid

COIN = ObjectKind("coin", "C", stepped_on=True)
MUD = ObjectKind("mud", "M", stepped_on=True)
MUSHROOM = ObjectKind("mushroom", "S", carried=True)
GATE = ObjectKind("gate", "T", opens=True, hides=True)
BERRY = ObjectKind("berry", "Y", stepped_on=True)
TARGET = ObjectKind("target", "X", stepped_on=True)
STONE = ObjectKind("stone", "Q", hides=False)
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
COLOURS = ("red", "green", "blue")


class Patrol(GridWorld):
    """Collect the coins; guards move at random and catch whom they stand beside."""

    kinds = (COIN,)
    coins = Int()
    guards = IntArray(3)

    def __init__(self, coins_to_collect=5, **options):
        super().__init__(width=12, height=12, max_steps=200, mission="collect the coins", **options)
        self.coins_to_collect = coins_to_collect

    def layout(self, grid):
        grid.wall_rect()
        grid.place_agent()
        for guard in range(3):
            self.guards[guard] = grid.place(ball("red")).identity
        for _ in range(self.coins_to_collect):
            grid.place(COIN("yellow"))

    def reward_and_done(self, action, reward, terminated):
        x, y = self.state.position
        reward = 0.0
        if self.is_kind(self.state.cells[x, y], COIN):
            self.state.cells[x, y] = EMPTY
            self.coins += 1
            reward = 1 / self.coins_to_collect
        for guard in self.guards:
            place = self.state.find(guard)
            if place is None:
                continue
            dx, dy = STEPS[self.draw(0, 4)]
            self.move(guard, place[0] + dx, place[1] + dy)
            guard_x, guard_y = self.state.find(guard)
            if abs(guard_x - x) + abs(guard_y - y) <= 1:
                return -1.0, True
        return reward, self.coins == self.coins_to_collect


class Corridor(GridWorld):
    """The page's first world, as it stands there."""

    def __init__(self, length=9, **options):
        super().__init__(width=length, height=5, max_steps=100, mission="get out", **options)

    def layout(self, grid):
        grid.wall_rect()
        x = grid.integer(3, grid.width - 3)
        grid.down(x, 1, 3)
        grid.put(door("red", locked=True), x, 2)
        grid.put(goal(), grid.width - 2, 2)
        grid.place_agent(size=(x, grid.height))
        grid.place(key("red"), size=(x, grid.height))


class Touch(GridWorld):
    """Success is to face the ball."""

    ball = IntTuple(3)

    def __init__(self, **options):
        super().__init__(width=8, height=8, max_steps=50, mission="face the ball", **options)

    def layout(self, grid):
        grid.wall_rect()
        self.ball = grid.place(ball("blue"))
        grid.place_agent()

    def reward_and_done(self, action, reward, terminated):
        (x, y), direction = self.state.position, self.state.direction
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[direction]
        return (1.0, True) if (x + dx, y + dy) == self.ball[1:] else (reward, terminated)


class Bog(GridWorld):
    """Bring the mushroom through the gate, without stepping into mud."""

    kinds = (MUD, MUSHROOM, GATE)

    def __init__(self, **options):
        super().__init__(width=9, height=7, max_steps=100, mission="bring the mushroom home", **options)

    def layout(self, grid):
        grid.wall_rect()
        grid.down(5, 1, 5)
        grid.put(GATE("red"), 5, 3)
        grid.put(goal(), 7, 3)
        for _ in range(4):
            grid.place(MUD("yellow"), size=(5, 7))
        grid.place(MUSHROOM("purple"), size=(5, 7))
        grid.place_agent(size=(5, 7))

    def reward_and_done(self, action, reward, terminated):
        on = self.state.cells[self.state.position]  # what the agent stands on
        if self.is_kind(on, MUD):
            return -0.1, terminated
        return (reward if self.is_kind(self.state.carrying, MUSHROOM) else 0.0), terminated


class Garden(GridWorld):
    """Eat berries, which grow again; without food the episode ends. Agents see their energy."""

    kinds = (BERRY,)
    observed = ("energy", "eaten", "is_hungry")
    energy = Float()
    eaten = Int()
    is_hungry = Bool()

    def __init__(self, growth=0.05, **options):
        super().__init__(width=9, height=9, max_steps=300, mission="stay alive", **options)
        self.growth = growth

    def layout(self, grid):
        grid.wall_rect()
        self.energy = 1.0
        for _ in range(6):
            grid.place(BERRY("red"), reject=lambda x, y: (x + y) % 2 == 0)
        grid.place_agent()

    def free_neighbours(self, x, y):
        return sum(1 for dx, dy in STEPS if self.code_at(x + dx, y + dy) == EMPTY)

    def reward_and_done(self, action, reward, terminated):
        x, y = self.state.position
        self.energy -= 0.02
        reward = -0.001 * self.free_neighbours(x, y)
        if self.is_kind(self.code_at(x, y), BERRY):
            self.remove(x, y)
            self.energy = min(1.0, self.energy + 0.3)
            self.eaten += 1
            reward += 1.0
        if self.np_random.random() < self.growth:
            column = int(self.np_random.integers(1, 8))
            row = int(self.np_random.integers(1, 8))
            if self.code_at(column, row) == EMPTY and (column, row) != (x, y):
                self.put(BERRY("red"), column, row)
        self.is_hungry = self.energy < 0.3
        return reward, self.energy <= 0


LEVEL = """WWWWWWWWWWWWWW
WW          WW
WW  QbQb    WW
WW    Xg  XgWW
WW  >>      WW
WWWWWWWWWWWWWW"""


class Sokoban(GridWorld):
    """Push both stones onto the targets; "toggle" pushes what is in front."""

    kinds = (TARGET, STONE)
    targets = IntArray(2, 2)
    pushes = Int()

    def __init__(self, **options):
        super().__init__(width=7, height=6, max_steps=120, mission="push the stones onto the targets", **options)

    def layout(self, grid):
        from_text(LEVEL, grid)
        self.targets[0] = 3, 3
        self.targets[1] = 5, 3
        if grid.integer(0, 2):
            grid.put_agent(1, 1, 0)

    def reward_and_done(self, action, reward, terminated):
        if action == 5:
            x, y = self.state.position
            dx, dy = STEPS[self.state.direction]
            beyond = self.code_at(x + 2 * dx, y + 2 * dy)
            is_free = beyond == EMPTY or self.is_kind(beyond, TARGET)
            if self.is_kind(self.code_at(x + dx, y + dy), STONE) and is_free:
                self.remove(x + dx, y + dy)
                self.put(STONE("blue"), x + 2 * dx, y + 2 * dy)
                self.pushes += 1
                for row, column in self.targets:
                    if (row, column) == (x + dx, y + dy):
                        self.put(TARGET("green"), x + dx, y + dy)
        placed = 0
        for column, row in self.targets:
            placed += self.is_kind(self.code_at(column, row), STONE)
        return (1.0 if placed == 2 else -0.01), placed == 2


class Errand(GridWorld):
    """Go to the balls in the order that the mission says."""

    first = Int()
    visited = Int()

    def __init__(self, **options):
        words = dict(enumerate(COLOURS))
        mission = MissionSpace("visit the {} ball {} times", words, {1: "1", 2: "2", 3: "3"})
        super().__init__(width=9, height=9, max_steps=100, mission=mission, **options)

    def layout(self, grid):
        grid.wall_rect()
        for colour in COLOURS:
            grid.place(ball(colour))
        colour = grid.choice(COLOURS)
        self.first = grid.integer(1, 4)
        grid.mission = f"visit the {colour} ball {self.first} times"
        grid.place_agent()

    def reward_and_done(self, action, reward, terminated):
        x, y = self.state.position
        near = [0, 0, 0]
        for dx, dy in STEPS:
            code = self.state.cells[x + dx, y + dy]
            if kind_of(code) == 6:
                near[code >> 4 & 3] += 1
        if any(count > 0 for count in near):
            self.visited += 1
        return float(near[0] > 0), self.visited // 2 >= self.first


class Harvest(TeamGrid):
    """Four bodies eat berries; each earns what it eats, and less where others stand near."""

    bodies = 4
    kinds = (BERRY,)
    shared_reward = False
    eaten = IntArray(4)

    def __init__(self, **options):
        super().__init__(width=10, height=10, max_steps=150, mission="eat the berries", **options)

    def layout(self, grid):
        grid.wall_rect()
        for body in range(self.bodies):
            grid.place_agent(body=body)
        for _ in range(20):
            grid.place(BERRY("red"))

    def reward_and_done(self, actions, rewards, terminated):
        earned = [0.0] * 4
        for body in range(self.bodies):
            x, y, _direction, _carried = self.body(body)
            if self.is_kind(self.code_at(x, y), BERRY):
                self.remove(x, y)
                self.eaten[body] += 1
                earned[body] = 1.0
            if actions[body] == 2:
                earned[body] -= 0.01
        return tuple(earned), sum(self.eaten) == 20
