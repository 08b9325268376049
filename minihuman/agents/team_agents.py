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
SIDESTEP = 0.3  # probability that a cook whose way another one blocks or may enter waits or moves at random


def beside(cell: Cell) -> set[Cell]:
    """Return the four neighbours of a cell."""
    return {(cell[0] + step_x, cell[1] + step_y) for step_x, step_y in STEPS}


def towards(place: Cell, cell: Cell) -> int:
    """Return the index in `STEPS` of the step from a place to a neighbouring cell."""
    return STEPS.index((cell[0] - place[0], cell[1] - place[1]))


def find_way(start: Cell, is_goal: Callable[[Cell], bool], floor: Collection[Cell]) -> list[Cell] | None:
    """Return the shortest path over a floor, from the cell after the start to the goal; None if there is none."""
    came: dict[Cell, Cell] = {start: start}
    waiting = deque([start])
    while waiting:
        cell = waiting.popleft()
        if is_goal(cell):
            way = []
            while cell != start:
                way.append(cell)
                cell = came[cell]
            return way[::-1]
        for step_x, step_y in STEPS:  # in their order, so that equally short ways are always the same
            after = cell[0] + step_x, cell[1] + step_y
            if after in floor and after not in came:
                came[after] = cell
                waiting.append(after)
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
            chances[: fields.INTERACT] += np.float32(SIDESTEP / fields.INTERACT)
        return chances


class KitchenSearch(FullViewSearch):
    """A plan for a simulated participant in a kitchen, all of which is in sight; it acts as the agent ``cook``."""

    def plan(self) -> list[str]:
        """Return a list that contains only the next action."""
        env = self._world.unwrapped
        return [self._world.action_names[KitchenView(env.team, env.seat).choose()[0]]]


class KitchenView:
    """One state of a kitchen, as one cook sees it."""

    def __init__(self, kitchen: Kitchen, seat: int) -> None:
        row = self.row = kitchen.row
        width, height, cooks = row[:3].tolist()
        cooks_end = fields.COOK + _FIELDS_PER_COOK * cooks
        others = row[fields.COOK : cooks_end].reshape(cooks, _FIELDS_PER_COOK).tolist()
        x, y, self.facing, self.held_thing = others.pop(seat)
        self.place = (x, y)
        self.other_places = {(other_x, other_y) for other_x, other_y, _, _ in others}
        self.held_by_others = [held_thing for _, _, _, held_thing in others]
        cells = [divmod(cell, height) for cell in range(width * height)]
        terrain, things = row[cooks_end:].reshape(2, -1).tolist()
        self.terrain = dict(zip(cells, terrain, strict=True))
        self.things = dict(zip(cells, things, strict=True))
        self.floor = set(self._find_cells(fields.FLOOR))
        self.region = self._find_region(self.place)
        prices = {recipe: self._read_price(recipe) for recipe in RECIPES}
        wanted_recipes = [recipe for recipe in RECIPES if prices[recipe]]
        self.orders = sorted(wanted_recipes, key=lambda recipe: -prices[recipe])

    def _read_price(self, recipe: str) -> int:
        """Return the reward for delivering a soup, by its numbers of onions ("o") and tomatoes ("t")."""
        n_onions = recipe.count("o")
        n_tomatoes = recipe.count("t")
        return int(self.row[fields.VALUES + n_onions + 4 * n_tomatoes])

    def choose(self) -> tuple[int, bool]:
        """Return the next action, and whether another cook blocks it."""
        for stations in self._list_tasks():
            if self._reaches(stations):
                return self._approach(stations)
        return fields.STAY, bool(self.other_places)

    def _list_tasks(self) -> list[list[Cell]]:
        """Return a list of stations for each task, the most urgent task first."""
        pots = self._find_cells(fields.POT)
        kind = kind_of(self.held_thing)
        active = [cell for cell in pots if self.things[cell] and clock_of(self.things[cell]) >= 0]
        if kind == fields.SOUP:
            return [self._find_cells(fields.HATCH), self._shared_counters()]
        if kind == fields.DISH:
            ready = [cell for cell in active if self._is_ready(cell)]
            return [ready, active, [cell for cell in pots if self.things[cell]], self._shared_counters()]
        if kind != fields.NOTHING:
            return [
                [cell for cell in pots if self._needs_ingredient(cell, kind)],
                self._shared_counters(),
                self._counters(0),
            ]
        dishes = self._counters(fields.DISH)
        brought = self.held_by_others.count(fields.DISH)
        if not self._reaches(active):
            brought += len(dishes)
        tasks = [[cell for cell in pots if self._is_complete(cell)], self._counters(fields.SOUP)]
        if len(active) > brought:
            tasks.append(dishes + self._find_cells(fields.DISHES))
        for kind, source in ((fields.ONION, fields.ONIONS), (fields.TOMATO, fields.TOMATOES)):
            if any(self._needs_ingredient(cell, kind) for cell in pots):
                if self._reaches(pots):
                    tasks.append(self._counters(kind))
                tasks.append(self._find_cells(source))
        return tasks

    def _find_cells(self, terrain: int) -> list[Cell]:
        return [cell for cell, cell_terrain in self.terrain.items() if cell_terrain == terrain]

    def _counters(self, kind: int) -> list[Cell]:
        """Return the counters that hold an object of a kind; 0 stands for empty counters."""
        return [cell for cell in self._find_cells(fields.COUNTER) if kind_of(self.things[cell]) == kind]

    def _shared_counters(self) -> list[Cell]:
        """Return the free counters that can be reached by a cook whose part of the floor this cook cannot reach."""
        apart = [self._find_region(other) for other in self.other_places if other not in self.region]
        return [cell for cell in self._counters(0) if any(not region.isdisjoint(beside(cell)) for region in apart)]

    def _find_region(self, place: Cell) -> set[Cell]:
        """Return the floor cells that can be reached from a place if other cooks make way."""
        region = {place}
        waiting = [place]
        while waiting:
            new = beside(waiting.pop()) & self.floor - region
            region |= new
            waiting += new
        return region

    def _reaches(self, cells: list[Cell]) -> bool:
        return any(not self.region.isdisjoint(beside(cell)) for cell in cells)

    def _is_ready(self, cell: Cell) -> bool:
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
        """Return whether a pot can be started, because more ingredients would not make a more valuable order."""
        waits = self.things[cell] and clock_of(self.things[cell]) < 0 and not self.row[fields.AUTOMATIC]
        return bool(waits) and not (
            self._needs_ingredient(cell, fields.ONION) or self._needs_ingredient(cell, fields.TOMATO)
        )

    def _approach(self, stations: list[Cell]) -> tuple[int, bool]:
        """Return the action that walks to the nearest station and uses it, and whether another cook blocks the way.

        At a pot that is still cooking, the action is to wait.
        """

        def is_there(cell: Cell) -> bool:
            return not beside(cell).isdisjoint(stations)

        way = find_way(self.place, is_there, self.floor - self.other_places)
        blocked = way is None
        if way is None:
            way = find_way(self.place, is_there, self.floor)
        if way:
            return towards(self.place, way[0]), blocked or not beside(way[0]).isdisjoint(self.other_places)
        station = next(cell for cell in stations if cell in beside(self.place))
        if self.facing != towards(self.place, station):
            return towards(self.place, station), False
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
        """Return probability 1 for the next turn or step towards the goal, or towards the bay."""
        team = world.unwrapped.team
        seat = world.unwrapped.seat
        state = team.state
        pose = team.pose(seat)
        place = int(pose.x), int(pose.z)
        free = {(x, y) for x, y in np.argwhere(state.kinds != WALL).tolist()}
        other_cells = {(int(other.x), int(other.z)) for other in map(team.pose, range(team.bodies))} - {place}
        is_own = (state.kinds == GOAL) & (state.colours == BODY_COLOURS[seat])
        own = {(x, y) for x, y in np.argwhere(is_own).tolist()}
        bay = {cell for cell in free if cell[1] == 1}  # the only free cell of the row above the corridor
        way = find_way(place, own.__contains__, free - other_cells)
        if way is None and self.argument == "insist":
            way = find_way(place, own.__contains__, free)
        elif way is None:
            way = find_way(place, bay.__contains__, free - other_cells) or []
        action = "stay"
        if way:
            quarter_turns = round(-pose.yaw_rad / _QUARTER_TURN_RAD)
            right_turns = (_QUARTER_TURNS_OF_STEPS[towards(place, way[0])] - quarter_turns) % 4
            action = {0: "forward", 3: "left"}.get(right_turns, "right")
        return np.array([name == action for name in world.action_names], np.float32)
