"""Partners for team worlds: a cook, and an agent that crosses a swap corridor and either gives way or insists.

They see the whole state of the world, as the planner does, and plan for one body; other bodies are obstacles. The world
of an agent in a team names the team world and the body: ``world.unwrapped.team`` and ``.seat``.
"""

from collections import deque
from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.agent import BaseAgent
from minihuman.agents.goal_search import FullViewSearch
from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.core import kitchen_rules as fields
from minihuman.worlds.grid.core.bodies import BODY_COLOURS
from minihuman.worlds.grid.core.cells import GOAL, WALL
from minihuman.worlds.grid.core.kitchen_rules import clock_of, kind_of, onions_in, recipe_of, tomatoes_in
from minihuman.worlds.grid.kitchen import RECIPES, Kitchen
from minihuman.worlds.grid.layouts.team_layouts import SwapCorridor

Cell = tuple[int, int]
STEPS = ((0, -1), (0, 1), (1, 0), (-1, 0))  # of a kitchen's actions: up, down, right, left
_QUARTER_TURNS_OF_STEPS = (3, 1, 0, 2)  # to the right from east, by the index of the step
_QUARTER_TURN_RAD = np.pi / 2
_FIELDS_PER_COOK = 4  # x, y, direction and what is held
_TOMATO_STRIDE = 4  # of the number of a recipe, which is onions + 4 * tomatoes
SIDESTEP = 0.3  # probability that a cook whose path another cook blocks or may enter waits or moves at random
_BAY_ROW = 1  # the row above a swap corridor, whose only free cell is the bay


def find_neighbours(cell: Cell) -> set[Cell]:
    """Return the four neighbours of a cell."""
    return {(cell[0] + step_x, cell[1] + step_y) for step_x, step_y in STEPS}


def find_step(start: Cell, neighbour: Cell) -> int:
    """Return the index in `STEPS` of the step from a cell to a neighbouring cell."""
    return STEPS.index((neighbour[0] - start[0], neighbour[1] - start[1]))


def find_path(start: Cell, is_goal: Callable[[Cell], bool], floor: Collection[Cell]) -> list[Cell] | None:
    """Return the cells of the shortest path over a floor to a goal, without the start; None if there is no path.

    The path is empty if the start is a goal. It is found by breadth-first search.
    """
    previous_cells: dict[Cell, Cell] = {start: start}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        if is_goal(cell):
            path = []
            while cell != start:
                path.append(cell)
                cell = previous_cells[cell]
            return path[::-1]
        for step_x, step_y in STEPS:  # in their order, so that of equally short paths always the same is returned
            neighbour = cell[0] + step_x, cell[1] + step_y
            if neighbour in floor and neighbour not in previous_cells:
                previous_cells[neighbour] = cell
                queue.append(neighbour)
    return None


class CookAgent(BaseAgent):
    """An agent that cooks and delivers soups, alone or with others: ``cook``.

    It does the most urgent task for what it holds: deliver, fill a plate, fill a pot, start a pot, fetch a plate, or
    fetch an ingredient. What it cannot bring to its destination it puts on a counter that another cook can reach.
    """

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Check that the world is a kitchen.

        Raises:
            SimulationError: if the world is not a kitchen.
        """
        if not isinstance(getattr(world.unwrapped, "team", None), Kitchen):
            raise SimulationError(
                f"{world.id} is not a kitchen, but the agent 'cook' plays only in kitchens; choose another agent"
            )

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return probability 1 for the next action of the most urgent task.

        If another cook blocks the action, the moves and waiting get a share of the probability.
        """
        action, is_blocked = KitchenView(world.unwrapped.team, world.unwrapped.seat).choose()
        chances = np.zeros(len(world.action_names), np.float32)
        chances[action] = 1
        if is_blocked:
            chances *= np.float32(1 - SIDESTEP)
            # the four moves and waiting are the actions before INTERACT
            chances[: fields.INTERACT] += np.float32(SIDESTEP / fields.INTERACT)
        return chances


class KitchenSearch(FullViewSearch):
    """A plan for a simulated participant in a kitchen, all of which is in sight; it acts as the agent ``cook``."""

    def plan(self) -> list[str]:
        """Return a list that contains only the next action."""
        env = self._world.unwrapped
        action, _ = KitchenView(env.team, env.seat).choose()
        return [self._world.action_names[action]]


class KitchenView:
    """One state of a kitchen, as the cook in a seat sees it; seats are numbered from 0."""

    def __init__(self, kitchen: Kitchen, seat: int) -> None:
        row = kitchen.row
        self.row = row
        width, height, n_cooks = row[:3].tolist()
        cooks_end = fields.COOK + _FIELDS_PER_COOK * n_cooks
        cooks = row[fields.COOK : cooks_end].reshape(n_cooks, _FIELDS_PER_COOK).tolist()
        x, y, self.facing, self.held_thing = cooks.pop(seat)  # the other cooks remain
        self.place = (x, y)
        self.other_places = {(other_x, other_y) for other_x, other_y, _, _ in cooks}
        self.held_by_others = [held_thing for _, _, _, held_thing in cooks]
        cells = [divmod(index, height) for index in range(width * height)]
        terrain, things = row[cooks_end:].reshape(2, -1).tolist()
        self.terrain = dict(zip(cells, terrain, strict=True))
        self.things = dict(zip(cells, things, strict=True))
        self.floor = set(self._find_cells(fields.FLOOR))
        self.region = self._find_region(self.place)
        prices = {recipe: self._read_price(recipe) for recipe in RECIPES}
        orders = [recipe for recipe in RECIPES if prices[recipe]]
        self.orders = sorted(orders, key=lambda recipe: -prices[recipe])  # the most valuable first

    def _read_price(self, recipe: str) -> int:
        """Return the reward for delivering a soup of a recipe, a text with an "o" per onion and a "t" per tomato."""
        n_onions = recipe.count("o")
        n_tomatoes = recipe.count("t")
        return int(self.row[fields.VALUES + n_onions + _TOMATO_STRIDE * n_tomatoes])

    def choose(self) -> tuple[int, bool]:
        """Return the next action of the most urgent possible task, and whether another cook blocks it.

        Without a possible task the cook stays; it counts as blocked if there is another cook.
        """
        for stations in self._list_tasks():
            if self._can_reach(stations):
                return self._approach(stations)
        return fields.STAY, bool(self.other_places)

    def _list_tasks(self) -> list[list[Cell]]:
        """Return for each task, the most urgent first, the cells of the stations at which it can be done."""
        pots = self._find_cells(fields.POT)
        held_kind = kind_of(self.held_thing)
        cooking_pots = [cell for cell in pots if self.things[cell] and clock_of(self.things[cell]) >= 0]
        if held_kind == fields.SOUP:
            return [self._find_cells(fields.HATCH), self._find_shared_counters()]
        if held_kind == fields.DISH:
            ready_pots = [cell for cell in cooking_pots if self._is_ready(cell)]
            filled_pots = [cell for cell in pots if self.things[cell]]
            return [ready_pots, cooking_pots, filled_pots, self._find_shared_counters()]
        if held_kind != fields.NOTHING:
            return [
                [cell for cell in pots if self._needs_ingredient(cell, held_kind)],
                self._find_shared_counters(),
                self._find_counters(fields.NOTHING),
            ]
        dishes = self._find_counters(fields.DISH)
        n_dishes_in_use = self.held_by_others.count(fields.DISH)
        if not self._can_reach(cooking_pots):
            n_dishes_in_use += len(dishes)  # those on counters are for another cook, who reaches the pots
        tasks = [[cell for cell in pots if self._is_complete(cell)], self._find_counters(fields.SOUP)]
        if len(cooking_pots) > n_dishes_in_use:
            tasks.append(dishes + self._find_cells(fields.DISHES))
        for kind, source in ((fields.ONION, fields.ONIONS), (fields.TOMATO, fields.TOMATOES)):
            if any(self._needs_ingredient(cell, kind) for cell in pots):
                if self._can_reach(pots):
                    tasks.append(self._find_counters(kind))
                tasks.append(self._find_cells(source))
        return tasks

    def _find_cells(self, terrain: int) -> list[Cell]:
        return [cell for cell, cell_terrain in self.terrain.items() if cell_terrain == terrain]

    def _find_counters(self, kind: int) -> list[Cell]:
        """Return the counters that hold an object of a kind; ``NOTHING`` is the kind of empty counters."""
        return [cell for cell in self._find_cells(fields.COUNTER) if kind_of(self.things[cell]) == kind]

    def _find_shared_counters(self) -> list[Cell]:
        """Return the empty counters that can be reached by a cook whose part of the floor this cook cannot reach."""
        other_regions = [self._find_region(place) for place in self.other_places if place not in self.region]
        return [
            cell
            for cell in self._find_counters(fields.NOTHING)
            if any(not region.isdisjoint(find_neighbours(cell)) for region in other_regions)
        ]

    def _find_region(self, place: Cell) -> set[Cell]:
        """Return the floor cells that can be reached from a place if other cooks make way."""
        region = {place}
        frontier = [place]
        while frontier:
            new_cells = find_neighbours(frontier.pop()) & self.floor - region
            region |= new_cells
            frontier += new_cells
        return region

    def _can_reach(self, cells: list[Cell]) -> bool:
        """Return whether this cook can get next to any of the cells if other cooks make way."""
        return any(not self.region.isdisjoint(find_neighbours(cell)) for cell in cells)

    def _is_ready(self, cell: Cell) -> bool:
        """Return whether the soup in a pot has cooked for the time of its recipe."""
        thing = self.things[cell]
        return clock_of(thing) >= int(self.row[fields.TIMES + recipe_of(thing)])

    def _needs_ingredient(self, cell: Cell, kind: int) -> bool:
        """Return whether a pot needs an ingredient for the most valuable order that its contents can still become."""
        thing = self.things[cell]
        if thing and clock_of(thing) >= 0:
            return False
        for recipe in self.orders:
            missing_onions = recipe.count("o") - onions_in(thing)
            missing_tomatoes = recipe.count("t") - tomatoes_in(thing)
            has_too_many = min(missing_onions, missing_tomatoes) < 0
            is_full = missing_onions + missing_tomatoes == 0
            if has_too_many or is_full:
                continue
            if kind == fields.TOMATO:
                return missing_tomatoes > 0
            return missing_onions > 0
        return False

    def _is_complete(self, cell: Cell) -> bool:
        """Return whether a cook has to start a pot, because no further ingredient would make a more valuable order."""
        thing = self.things[cell]
        if thing == fields.NOTHING or clock_of(thing) >= 0 or self.row[fields.AUTOMATIC]:
            return False
        return not (self._needs_ingredient(cell, fields.ONION) or self._needs_ingredient(cell, fields.TOMATO))

    def _approach(self, stations: list[Cell]) -> tuple[int, bool]:
        """Return the action that walks to the nearest station or uses it, and whether another cook blocks the path.

        A path also counts as blocked if another cook may enter its next cell. At a pot that is still cooking, the
        action is to wait.
        """

        def is_there(cell: Cell) -> bool:
            return not find_neighbours(cell).isdisjoint(stations)

        path = find_path(self.place, is_there, self.floor - self.other_places)
        is_blocked = path is None
        if path is None:
            path = find_path(self.place, is_there, self.floor)
        if path:
            can_be_entered = not find_neighbours(path[0]).isdisjoint(self.other_places)
            return find_step(self.place, path[0]), is_blocked or can_be_entered
        station = next(cell for cell in stations if cell in find_neighbours(self.place))
        if self.facing != find_step(self.place, station):
            return find_step(self.place, station), False
        is_fetching_soup = self.terrain[station] == fields.POT and kind_of(self.held_thing) == fields.DISH
        if is_fetching_soup and not self._is_ready(station):
            return fields.STAY, False
        return fields.INTERACT, False


class CorridorAgent(BaseAgent):
    """An agent that crosses a swap corridor.

    ``corridor:yield`` steps into the bay while another body blocks the way; ``corridor:insist`` walks straight on. The
    default is to yield.
    """

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Check the agent's argument, and that the world is a swap corridor.

        Raises:
            SimulationError: if either is not valid.
        """
        if self.argument not in ("", "yield", "insist"):
            raise SimulationError(
                f"agent corridor: unknown behaviour {self.argument!r}; use corridor:yield or corridor:insist"
            )
        if not isinstance(getattr(world.unwrapped, "team", None), SwapCorridor):
            raise SimulationError(
                f"{world.id} is not a swap corridor, and the agent corridor plays only those; choose another agent"
            )

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return probability 1 for the next turn or step towards the goal, or towards the bay; or to stay."""
        team = world.unwrapped.team
        seat = world.unwrapped.seat
        state = team.state
        pose = team.pose(seat)
        cell = int(pose.x), int(pose.z)
        free_cells = {(x, y) for x, y in np.argwhere(state.kinds != WALL).tolist()}
        body_poses = [team.pose(body) for body in range(team.bodies)]
        other_cells = {(int(body_pose.x), int(body_pose.z)) for body_pose in body_poses} - {cell}
        is_own_goal = (state.kinds == GOAL) & (state.colours == BODY_COLOURS[seat])
        own_goals = {(x, y) for x, y in np.argwhere(is_own_goal).tolist()}
        bay = {(x, y) for x, y in free_cells if y == _BAY_ROW}
        path = find_path(cell, own_goals.__contains__, free_cells - other_cells)
        if path is None and self.argument == "insist":
            path = find_path(cell, own_goals.__contains__, free_cells)
        elif path is None:
            path = find_path(cell, bay.__contains__, free_cells - other_cells)
        action = "stay"
        if path:
            facing_turns = round(-pose.yaw_rad / _QUARTER_TURN_RAD)  # quarter turns to the right from east
            right_turns = (_QUARTER_TURNS_OF_STEPS[find_step(cell, path[0])] - facing_turns) % 4
            action = {0: "forward", 3: "left"}.get(right_turns, "right")
        return np.array([name == action for name in world.action_names], np.float32)
