"""Team worlds of the catalogue: FourRooms, DoorKey with two keys, a swap corridor, a load to carry, hide and seek."""

from minihuman.worlds.colours import COLOURS, Colour
from minihuman.worlds.contract import View
from minihuman.worlds.grid.core.bodies import BODY_COLOURS, CARRY, HIDE, MAX_BODIES, OWN_GOALS
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.object_kinds import ball, box, door, goal, key, wall
from minihuman.worlds.grid.team_grid import TeamGrid
from minihuman.worlds.options import check_whole


class TeamFourRooms(TeamGrid):
    """Four rooms with one goal. All bodies search for it, and all earn the reward when one finds it."""

    def __init__(self, *, bodies: int = 2, max_steps: int = 100, view: View = "partial") -> None:
        self.bodies = check_whole("bodies", bodies, 1, MAX_BODIES)
        mission = "find the green goal: when one of you reaches it, all of you have won"
        super().__init__(width=19, height=19, max_steps=max_steps, mission=mission, view=view)

    def layout(self, grid: Layout) -> None:
        """Lay out four rooms, with a gap in each wall between them."""
        grid.wall_rect()
        grid.across(1, 9, 17)
        grid.down(9, 1, 17)
        for low in (1, 10):
            grid.clear(9, grid.integer(low, low + 8))
            grid.clear(grid.integer(low, low + 8), 9)
        for body in range(self.bodies):
            grid.place_agent(body=body)
        grid.place(goal())


class TwoKeyDoorKey(TeamGrid):
    """Three rooms in a row with two locked doors, whose keys lie in the first room; each body can carry one key."""

    def __init__(self, *, max_steps: int = 300, view: View = "partial") -> None:
        mission = "bring both keys to their doors, then each go to the goal of your own colour"
        super().__init__(width=13, height=8, max_steps=max_steps, mission=mission, view=view)

    def layout(self, grid: Layout) -> None:
        """Lay out the rooms, with both keys in the first room and the goals in the third."""
        grid.wall_rect()
        doors: tuple[tuple[int, Colour], ...] = ((6, "yellow"), (9, "purple"))
        for x, colour in doors:
            grid.down(x, 1, 6)
            grid.put(door(colour, locked=True), x, 1 + grid.integer(0, 6))
            grid.place(key(colour), top=(1, 1), size=(5, 6))
        for body in range(self.bodies):
            grid.place_agent(top=(1, 1), size=(5, 6), body=body)
            grid.place(goal(COLOURS[BODY_COLOURS[body]]), top=(11, 1), size=(1, 6))
        grid.task(OWN_GOALS)


class SwapCorridor(TeamGrid):
    """A corridor one cell wide with a bay. Each body must get to the opposite end, so one has to give way."""

    shared_reward = False

    def __init__(self, *, length: int = 9, max_steps: int = 100, view: View = "full") -> None:
        check_whole("length", length, 5, 31, odd=True)
        mission = "go to the goal of your own colour at the other end; the corridor is one cell wide and has one bay"
        super().__init__(width=length + 2, height=4, max_steps=max_steps, mission=mission, view=view)

    def layout(self, grid: Layout) -> None:
        """Lay out the corridor, with the bay in the middle column or one column from it."""
        last = grid.width - 2
        grid.wall_rect()
        grid.across(1, 1, last)
        grid.clear(grid.width // 2 + grid.integer(-1, 2), 1)
        for body, (x, across, direction) in enumerate(((1, last, 0), (last, 1, 2))):
            grid.put_agent(x, 2, direction, body=body)
            grid.put(goal(COLOURS[BODY_COLOURS[body]]), across, 2)
        grid.task(OWN_GOALS)


class CarryTogether(TeamGrid):
    """A load that two bodies must carry from opposite sides, through a gap to the goal."""

    def __init__(self, *, max_steps: int = 200, view: View = "full") -> None:
        mission = "take the heavy purple box from two opposite sides and carry it together to the green goal"
        super().__init__(width=13, height=7, max_steps=max_steps, mission=mission, view=view)

    def layout(self, grid: Layout) -> None:
        """Lay out two rooms, with the load and all bodies in the left one and the goal in the right one."""
        grid.wall_rect()
        grid.down(6, 1, 5)
        grid.clear(6, grid.integer(2, 5))
        load = grid.place(box("purple"), top=(2, 2), size=(3, 3))
        grid.place(goal(), top=(8, 2), size=(3, 3))
        for body in range(self.bodies):
            grid.place_agent(top=(1, 1), size=(5, 5), body=body)
        grid.task(CARRY, load.identity)


class HideAndSeek(TeamGrid):
    """Hide and seek: one body seeks, and the others hide behind walls or behind balls that they put into gaps."""

    shared_reward = False

    def __init__(self, *, bodies: int = 2, head_start: int = 15, max_steps: int = 120, view: View = "partial") -> None:
        self.bodies = check_whole("bodies", bodies, 2, MAX_BODIES)
        self._head_start = check_whole("head_start", head_start, 0, max_steps)
        mission = f"red seeks, after {head_start} steps; the others hide where red does not see them"
        super().__init__(width=13, height=13, max_steps=max_steps, mission=mission, view=view)

    def layout(self, grid: Layout) -> None:
        """Lay out four rooms with a gap in each wall, and a block and a ball in each room."""
        grid.wall_rect()
        grid.across(1, 6, 11)
        grid.down(6, 1, 11)
        for low in (1, 7):
            grid.clear(6, grid.integer(low, low + 5))
            grid.clear(grid.integer(low, low + 5), 6)
            for left in (1, 7):
                grid.place(wall(), top=(left + 1, low + 1), size=(3, 3))
                grid.place(ball("yellow"), top=(left, low), size=(5, 5))
        for body in range(self.bodies):
            grid.place_agent(body=body)
        grid.task(HIDE, self._head_start)
