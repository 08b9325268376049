"""Kitchen: cooks put onions and tomatoes into pots and bring soups to the serving hatch, as in Overcooked-AI.

The dynamics are in `core.kitchen_rules`. `KITCHENS` has Overcooked-AI's layouts, with their orders and the value and
cooking time of each recipe. A plan has one letter per cell and slashes between rows: X counter, P pot, O onions,
T tomatoes, D dishes, S serving hatch, a space for the floor, a digit where that cook begins. Orders are recipes as
letters: "oot" is two onions and a tomato. `KitchenBatch` steps many kitchens at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.grid.core import kitchen_rules as fields
from minihuman.worlds.grid.core.kitchen_rules import Row, kitchen_row_length, observe, step_kitchen, step_kitchens
from minihuman.worlds.grid.pictures.team_pictures import (
    THING_COLOURS,
    THING_NAMES,
    draw_kitchen_tile,
    list_kitchen_tiles,
)
from minihuman.worlds.hashing import hash64
from minihuman.worlds.options import check_one_of, check_whole
from minihuman.worlds.pose import Map, Pose, Thing, wall_outlines
from minihuman.worlds.step_limit import check_max_steps
from minihuman.worlds.team import PictureTiles, TeamBatch, TeamStep, TeamWorld

CELLS = " PXOTDS"  # by terrain number
RECIPES = ("o", "t", "oo", "ot", "tt", "ooo", "oot", "ott", "ttt")
USUAL_REWARD = 20  # of a soup, where a layout states none
USUAL_TIME = 20  # the steps in which a soup cooks, where a layout states none


@dataclass(frozen=True, slots=True)
class KitchenLayout:
    """The floor plan and the orders of a kitchen.

    Args:
        plan: the cells, row by row.
        orders: the recipes that earn a reward; if there are none, every recipe does.
        bonus: the recipes that earn twice as much.
        values: the reward of each order, in the sequence of ``orders``; empty for 20 each.
        times: the cooking time of each order in steps, in the sequence of ``orders``; empty for 20 each.
        per_ingredient: the reward of an onion and of a tomato, and the cooking time of an onion and of a tomato; used
            for what ``values`` and ``times`` do not say, instead of 20, unless it is 0.
    """

    plan: str
    orders: tuple[str, ...] = ("ooo",)
    bonus: tuple[str, ...] = ()
    values: tuple[int, ...] = ()
    times: tuple[int, ...] = ()
    per_ingredient: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        """Check that the plan is a valid kitchen.

        Raises:
            WorldError: if its rows, cooks or edge are not as they must be.
        """
        rows = self.plan.split("/")
        cooks = sorted(letter for letter in self.plan if letter.isdigit())
        if cooks != [str(number) for number in range(1, len(cooks) + 1)] or not 1 <= len(cooks) <= 8:
            raise WorldError(f"the kitchen's cooks are marked {cooks}; mark where they begin 1, 2, ... up to 8")
        if len({len(row) for row in rows}) > 1 or not set(self.plan) <= set(CELLS + "/12345678"):
            raise WorldError(
                "a kitchen's rows must be equally long and contain only X P O T D S, spaces and cooks' digits"
            )
        edge = rows[0] + rows[-1] + "".join(row[0] + row[-1] for row in rows)
        if not set(edge) <= set(CELLS[1:]):
            raise WorldError("a kitchen's edge must not have floor; use only X, P, O, T, D or S along it")

    @property
    def cooks(self) -> int:
        """Return the number of cooks."""
        return sum(map(str.isdigit, self.plan))

    def value(self, recipe: str) -> int:
        """Return the reward for delivering a soup of a recipe, including the bonus; 0 for one that is not ordered."""
        if self.orders and recipe not in self.orders:
            return 0
        onion, tomato, _, _ = self.per_ingredient
        if self.values:
            reward = self.values[self.orders.index(recipe)]
        else:
            reward = onion * recipe.count("o") + tomato * recipe.count("t") or USUAL_REWARD
        return 2 * reward if recipe in self.bonus else reward

    def time(self, recipe: str) -> int:
        """Return the cooking time of a soup of a recipe in steps."""
        _, _, onion, tomato = self.per_ingredient
        if self.times and recipe in self.orders:
            return self.times[self.orders.index(recipe)]
        if onion:
            return onion * recipe.count("o") + tomato * recipe.count("t")
        return USUAL_TIME


_SHARED = (21, 13, 15, 7)  # `per_ingredient` of several layouts with tomatoes

KITCHENS: Mapping[str, KitchenLayout] = MappingProxyType(
    {
        "asymmetric_advantages": KitchenLayout("XXXXXXXXX/O XSXOX S/X   P 1 X/X2  P   X/XXXDXDXXX"),
        "asymmetric_advantages_tomato": KitchenLayout(
            "XTXXXXXOX/D XOXTX S/X   P 1 X/X2  X   X/XXXSXDXXX",
            orders=("ooo", "oot", "ttt", "t"),
            bonus=("ttt", "oot"),
            per_ingredient=_SHARED,
        ),
        "bonus_order_test": KitchenLayout(
            "XXPXX/O  2T/X1  X/XDXSX",
            orders=("ooo", "ttt", "ot"),
            bonus=("ot", "ttt"),
            values=(10, 20, 15),
            times=(20, 15, 10),
        ),
        "bottleneck": KitchenLayout("XXOXDXX/X 1X2 X/X  X  X/X     X/XSXXPPX"),
        "centre_objects": KitchenLayout("XXXXXXX/X  1  X/X P S X/X     X/X D O X/X  2  X/XXXXXXX"),
        "centre_pots": KitchenLayout("XXXOSSX/X  1  X/X P P X/X  2  X/XDDOXXX"),
        "coordination_ring": KitchenLayout("XXXPX/X 1 P/D2X X/O   X/XOSXX"),
        "corridor": KitchenLayout(
            "XXXXXOXXDXXXXX/X  1  XX  2  X/X     XX     X/X  XXXXXXXX  X/X            X/X  XXXXXXXX  X/"
            "X     XX     X/X     XX     X/XXXXXSXXPPXXXX"
        ),
        "counter_circuit": KitchenLayout(
            "XXXPDPXXX/X   2   X/X XXXXX X/X   1   X/XXXOSTXXX",
            orders=("ott", "oot", "ot"),
            bonus=("ot",),
            per_ingredient=_SHARED,
        ),
        "counter_circuit_o_1order": KitchenLayout("XXXPPXXX/X  2   X/D XXXX S/X  1   X/XXXOOXXX"),
        "cramped_corridor": KitchenLayout(
            "XTPXXXXSX/D      2X/XXXX XXXX/D      1X/XOPXXXXSX",
            orders=("t", "ooo", "ttt", "ot", "tt"),
            bonus=("ot", "t", "tt"),
            per_ingredient=_SHARED,
        ),
        "cramped_room": KitchenLayout("XXPXX/O  2O/X1  X/XDXSX"),
        "cramped_room_o_3orders": KitchenLayout(
            "XXPXX/O  2X/X1  X/XDXSX", orders=("ooo", "oo", "o"), values=(20, 9, 4)
        ),
        "cramped_room_single": KitchenLayout("XXPXX/O   O/X1  X/XDXSX"),
        "cramped_room_tomato": KitchenLayout(
            "XXPXX/O  2T/X1  X/XDXSX", orders=("ooo", "ttt", "ot"), bonus=("ot",), per_ingredient=(15, 10, 10, 10)
        ),
        "five_by_five": KitchenLayout("XDPXX/X   S/O 2 X/X1  D/XOXPX"),
        "forced_coordination": KitchenLayout("XXXPX/O X1P/O2X X/D X X/XXXSX"),
        "forced_coordination_tomato": KitchenLayout(
            "XXXPX/T X1P/O2X X/S X X/XXXDX",
            orders=("ooo", "ott", "oot", "ttt"),
            values=(10, 10, 10, 15),
            times=(10, 10, 10, 10),
        ),
        "inverse_marshmallow_experiment": KitchenLayout(
            "XOXXXXXXXXXOX/X     X     X/XXXX  D  XXXX/XXS 2 P 1 SXX/XXXXXTXTXXXXX",
            orders=("o", "t", "oot", "ooo", "ttt"),
            bonus=("ooo",),
            per_ingredient=_SHARED,
        ),
        "large_room": KitchenLayout("XXXPXXX/O    2O/X     X/X     X/X     X/X1    X/XDXXXSX"),
        "long_cook_time": KitchenLayout(
            "XOXXXXXXXXXXX/X XXXXXXXXXXX/X  1        X/X           P/X  2        X/X DXXXXXXXXXX/XSXXXXXXXXXXX",
            orders=("ooo", "oo", "o"),
            values=(10, 10, 10),
            times=(100, 100, 100),
        ),
        "m_shaped_s": KitchenLayout("XPXXX/O X2O/X1  X/XDXSX"),
        "marshmallow_experiment": KitchenLayout(
            "XXXXXXXXXXXXX/O   DTXTD   O/XX    P    XX/S   2 P 1   S/XXXXXTXTXXXXX",
            orders=("ooo", "ttt"),
            bonus=("ooo",),
            per_ingredient=_SHARED,
        ),
        "marshmallow_experiment_coordination": KitchenLayout(
            "XXXXXXXXXXXOX/X    XTTX   X/XXX  P    XXX/S  2 P 1    X/XXXXDXTTXXXXX",
            orders=("ooo", "ttt"),
            bonus=("ooo",),
            per_ingredient=_SHARED,
        ),
        "mdp_test": KitchenLayout(
            "XXPXX/O  2O/T1  T/XDPSX", orders=("o", "ooo", "oot"), bonus=("oot",), per_ingredient=(10, 5, 2, 2)
        ),
        "multiplayer_schelling": KitchenLayout("XXSPDXX/X  1  X/X  X  X/O3   4O/X  X  X/X  2  X/XXDPSXX"),
        "pipeline": KitchenLayout(
            "XXXPDPXXX/X       X/X XXXXX X/X X     X/X XXXXX X/X  1 2  X/XXXOSOXXX",
            orders=("ooo", "oo", "o"),
            bonus=("oo",),
            per_ingredient=_SHARED,
        ),
        "scenario1_s": KitchenLayout("XXOXDXX/X 1X2 X/X  X  X/X     X/XSXXPPX"),
        "scenario2": KitchenLayout("XXXXXOXXXX/S        O/D    1 2 X/XXXXXXPXXX"),
        "scenario2_s": KitchenLayout("XXOXXXX/S     O/D 1 2 X/XXXPXXX"),
        "scenario3": KitchenLayout("XXXXXOXXXX/S     XXPX/X    1   X/D XXXXXX X/X     2  O/XXXXXXXXXX"),
        "scenario4": KitchenLayout("XXXXXOXXXX/S      XPX/D    1   X/XXXXXXXX X/XXXXXX2  O/XXXXXXXXXX"),
        "schelling": KitchenLayout("XXSPDXX/X  1  X/X  X  X/O     O/X  X  X/X  2  X/XXDPSXX"),
        "schelling_s": KitchenLayout("XSPDX/X 1 X/O   O/X 2 X/XDPSX"),
        "simple_o": KitchenLayout("XXPXX/X  2X/X1  O/XXDSX", times=(5,)),
        "simple_o_t": KitchenLayout("XXPXX/T  2T/X1  O/XXDSX", orders=("ooo", "ttt"), values=(20, 15), times=(5, 5)),
        "simple_tomato": KitchenLayout("XXPXX/T  2T/X1  O/XXDSX", orders=("ttt",)),
        "small_corridor": KitchenLayout("XXXXXOXDXXXXX/X  1  X  2  X/X  XXXXXXX  X/X           X/XSXXXXXXXXPPX"),
        "soup_coordination": KitchenLayout(
            "XXXDTXOXXXX/X    X    X/S 2  P  1 S/X    X    X/XXXXOXTDXXX",
            orders=("oot", "ttt", "ot", "t", "o"),
            bonus=("t", "oot", "ttt", "o"),
            per_ingredient=_SHARED,
        ),
        "tutorial_0": KitchenLayout("XXPXXXX/O   2 S/XXPDXXX/O   1 S/XXXXXXX", per_ingredient=_SHARED),
        "tutorial_2": KitchenLayout("XXPXXXX/O   2 S/XTPDXXX/O   1 S/XXXXXXX", orders=(), per_ingredient=_SHARED),
        "unident": KitchenLayout("XXXXXXXXXXX/O XXSXOXX S/X    P  1 X/X2   P    X/XXXXDXDXXXX"),
        "you_shall_not_pass": KitchenLayout(
            "XXXXXSSSXXXXX/XXTSSS SSSOXX/P 1       2 P/XXDSSSSSSSDXX",
            orders=("o", "t", "oot", "ott", "ttt", "oo"),
            bonus=("oot", "ott"),
            per_ingredient=_SHARED,
        ),
    }
)


DRAWN = "drawn"  # the layout that is drawn from an episode's seed


def draw_layout(seed: int) -> KitchenLayout:
    """Return a kitchen, drawn from a seed, of two rooms with counters between them, in which a soup takes both cooks.

    One room has the onions and the plates, the other the pot and the hatch; both cooks reach only the counters.
    """
    *draws, swapped, mirrored = np.random.SeedSequence(seed).generate_state(8).tolist()  # a draw for each letter
    rows = [[*"XXXXXXX"], *([*"X  X  X"] for _ in range(4)), [*"XXXXXXX"]]
    contents = ("OD1", "PS2") if swapped % 2 else ("OD2", "PS1")  # of each room
    for room, letters in enumerate(contents):
        is_right_room = room == mirrored % 2
        edge = [*((0, y) for y in range(1, 5)), *((x, y) for x in (1, 2) for y in (0, 5))]
        for letter in letters:
            if letter.isdigit():
                cells = [(x, y) for x in (1, 2) for y in range(1, 5)]
            else:
                cells = edge
            x, y = cells.pop(draws.pop() % len(cells))
            rows[y][6 - x if is_right_room else x] = letter
    return KitchenLayout("/".join(map("".join, rows)))


KitchenRules = Literal["2019", "1.1.0"]
YAWS_RAD = (np.pi / 2, -np.pi / 2, 0.0, np.pi)  # by direction: up, down, right, left
_COOK_NUMBERS = 4  # of a cook in a row: column, row, direction, and what they carry
SOUP_2019 = 5  # what a soup earned in the recordings of 2019


class Kitchen(TeamWorld):
    """A kitchen of Overcooked-AI with exactly its dynamics.

    All cooks earn the reward of a delivery. After a step that earned something, ``info`` has each cook's contribution
    and Overcooked-AI's shaping rewards, by cook: ``{"delivered": (20.0, 0.0), "shaping": (0.0, 3.0)}``.

    Args:
        layout: a name in `KITCHENS`, a floor plan in the same letters ("XXPXX/O  2O/X1  X/XDXSX"), or a
            `KitchenLayout`; or "drawn" for a new layout from each seed, by `draw_layout`.
        rules: "1.1.0" for the rules of that version, "2019" for those under which its human data were recorded.
        max_steps: the number of joint steps in an episode.
        ends_at_soup: whether the first soup that earns a reward ends the episode as a success.

    Attributes:
        layout: the floor plan and the orders.
        rules: the rules.
        row: the state, int32; `core.kitchen_rules` names its fields.
    """

    action_names = ("up", "down", "right", "left", "stay", "interact")
    idle_action = fields.STAY

    def __init__(
        self,
        *,
        layout: str | KitchenLayout = "cramped_room",
        rules: KitchenRules = "1.1.0",
        max_steps: int = 400,
        ends_at_soup: bool = False,
    ) -> None:
        self._draws_layout = layout == DRAWN
        self._ends_at_soup = ends_at_soup
        if layout == DRAWN:
            layout = draw_layout(0)
        elif isinstance(layout, str):
            if "/" in layout:
                layout = KitchenLayout(layout)
            else:
                layout = KITCHENS[check_one_of("layout", layout, KITCHENS)]
        has_old_rules = check_one_of("rules", rules, ("2019", "1.1.0")) == "2019"
        self.rules: KitchenRules = rules
        self.layout = layout
        self.bodies = layout.cooks
        self.max_steps = check_max_steps(max_steps)
        self._start = _build_start_row(layout, self.max_steps, has_old_rules=has_old_rules)
        self.mission = _describe_mission(layout, has_old_rules=has_old_rules)
        self.row = self._start.copy()
        self.row[fields.PHASE] = fields.NEW
        shape = (*self.row[:2].tolist(), 5 * self.bodies + fields.BASE_LAYERS)
        self.observation_space = spaces.Box(0, 255, shape, np.uint8)
        self._images = np.zeros((self.bodies, *shape), np.uint8)
        self._flat_images = self._images.reshape(self.bodies, -1)
        self._outcomes = np.zeros(2 * self.bodies)
        self._actions = np.zeros(self.bodies, np.int64)
        self._nothing = TeamStep((0.0,) * self.bodies, False, False)

    def reset(self, seed: int | None = None) -> None:
        """Begin a new episode. The seed only affects a drawn layout."""
        if self._draws_layout:
            self.layout = draw_layout(self.choose_seed(seed))
            self._start = _build_start_row(self.layout, self.max_steps, has_old_rules=self.rules == "2019")
        self.row[:] = self._start
        observe(self.row, self._flat_images)

    def step(self, actions: Sequence[int]) -> TeamStep:
        """Make one joint step, with one action per cook.

        Raises:
            WorldError: outside an episode, for a wrong number of actions, and for an action that does not exist.
        """
        if len(actions) != self.bodies:
            self.check_actions(actions)
        joint_action = self._actions
        for body, action in enumerate(actions):  # takes a third of the time of an assignment to a slice
            joint_action[body] = action
        status = step_kitchen(self.row, self._actions, self._outcomes, self._flat_images)
        if status < 0:
            self.check_actions(actions)
            raise WorldError(
                "no episode is running in the kitchen; call reset() before step(), and again after each episode"
            )
        if status == 0:
            return self._nothing
        outcomes = self._outcomes.tolist()
        cooks = self.bodies
        ended = status & fields.ENDED != 0
        if not status & fields.EARNED:
            return self._nothing._replace(truncated=ended)
        delivered = tuple(outcomes[:cooks])
        info = {"delivered": delivered, "shaping": tuple(outcomes[cooks:])}
        terminated = self._ends_at_soup and sum(delivered) > 0
        if terminated:
            self.row[fields.PHASE] = fields.OVER
        return TeamStep((sum(delivered),) * cooks, terminated, ended and not terminated, info)

    def observation(self, body: int) -> NDArray[np.uint8]:
        """Return the whole kitchen in layers, the observing cook's own first: uint8[width, height, 5 * cooks + 16]."""
        return self._images[body].copy()

    def frame(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> NDArray[np.uint8]:
        """Return a picture of the kitchen from above that fits the size; the observing cook ``body`` has a ring."""
        return self.picture_tiles(body, width, height, palette=palette).join()

    def picture_tiles(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> PictureTiles:
        """Return the picture of `frame` as tiles, one per cell."""
        columns, rows = self.row[:2].tolist()
        tile_px = max(1, min(width // columns, height // rows))
        cells = list_kitchen_tiles(self.row, check_whole("body", body, 0, self.bodies - 1), tile_px, palette)
        return PictureTiles(cells, columns, tile_px, draw_kitchen_tile)

    def pose(self, body: int) -> Pose:
        """Return a cook's cell (column, 0, row) and direction (yaw in radians)."""
        first = fields.COOK + _COOK_NUMBERS * check_whole("body", body, 0, self.bodies - 1)
        x, y, direction = self.row[first : first + 3].tolist()
        return Pose(float(x), 0.0, float(y), YAWS_RAD[direction])

    def map(self) -> Map:
        """Return the floor plan: the cells where cooks cannot stand, and every station by name."""
        width, height = self.row[:2].tolist()
        terrain = self.row[fields.COOK + _COOK_NUMBERS * self.bodies :][: width * height].reshape(width, height)
        things = tuple(
            Thing(THING_NAMES[terrain[x, y]], float(x), float(y), 0.5, THING_COLOURS[terrain[x, y]])
            for x, y in np.argwhere((terrain != fields.FLOOR) & (terrain != fields.COUNTER)).tolist()
        )
        bounds = (-0.5, -0.5, width - 0.5, height - 0.5)
        return Map("cell", bounds, wall_outlines(terrain != fields.FLOOR), things)

    def state_hash(self) -> int:
        """Return a uint64 hash of the kitchen, its orders, its cooks and all objects in it."""
        return hash64(["kitchen", self.row])

    def scene_hash(self) -> int:
        """Return the hash of the state without the number of steps taken."""
        return hash64(["kitchen", self.row[: fields.STEP], self.row[fields.STEP + 1 :]])

    def save(self) -> Row:
        """Return a copy of the state."""
        return self.row.copy()

    def restore(self, saved: Row) -> None:
        """Restore a saved state.

        Raises:
            WorldError: if it is of a kitchen of another size or with another number of cooks.
        """
        if saved.shape != self.row.shape or not np.array_equal(saved[:3], self.row[:3]):
            raise WorldError("the saved state is from another kitchen; restore it into one with the same layout")
        self.row[:] = saved
        observe(self.row, self._flat_images)

    def batch(self, num_worlds: int) -> "KitchenBatch":
        """Return a batch of ``num_worlds`` kitchens like this one, which one call steps.

        Raises:
            WorldError: if layouts are drawn, or the first soup ends an episode.
        """
        if self._draws_layout or self._ends_at_soup:
            raise WorldError('kitchens with layout="drawn" or ends_at_soup=True have no batch; step each by itself')
        return KitchenBatch(self, num_worlds)


class KitchenBatch(TeamBatch):
    """A batch of kitchens that are alike.

    After a step, the attribute `shaping` has Overcooked-AI's shaping rewards, float64[worlds, cooks].

    Args:
        world: the kitchen that is copied.
        num_worlds: the number of kitchens in the batch.
    """

    def __init__(self, world: Kitchen, num_worlds: int) -> None:
        super().__init__(world, num_worlds)
        self._start = world._start
        self.rows = np.tile(self._start, (num_worlds, 1))
        self._outcomes = np.zeros((num_worlds, 2 * world.bodies))
        self._images = self.observations.reshape(num_worlds, world.bodies, -1)

    def reset(self, seed: int) -> NDArray[np.uint8]:
        """Begin an episode in every kitchen; return the observations of all cooks. The seed has no effect."""
        self.rows[:] = self._start
        for row, images in zip(self.rows, self._images, strict=True):
            observe(row, images)
        return self.observations

    def step(self, actions: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.bool_]]:
        """Make one joint step in each kitchen; an episode that ends is followed by the next one in the same step."""
        self.check_actions(actions)
        refused = step_kitchens(self.rows, self._start, actions, self._outcomes, self._images, self.ends)
        if refused >= 0:
            raise WorldError(
                f"kitchen {refused} refused the actions {actions[refused].tolist()}; use actions from 0 to 5"
            )
        delivered, self.shaping = np.split(self._outcomes, 2, axis=1)
        return self.observations, np.broadcast_to(delivered.sum(axis=1, keepdims=True), delivered.shape), self.ends


def _build_start_row(layout: KitchenLayout, max_steps: int, *, has_old_rules: bool) -> Row:
    """Return the row with which an episode in a layout begins; ``has_old_rules`` stands for the rules of 2019."""
    plan = layout.plan.split("/")
    width = len(plan[0])
    height = len(plan)
    cooks = layout.cooks
    first_cell = fields.COOK + _COOK_NUMBERS * cooks
    row = np.zeros(kitchen_row_length(width, height, cooks), np.int32)
    row[: fields.AUTOMATIC + 1] = width, height, cooks, 0, max_steps, fields.PLAYING, has_old_rules
    for recipe in RECIPES:
        number = recipe.count("o") + 4 * recipe.count("t")
        reward = layout.value(recipe)
        row[fields.VALUES + number] = min(reward, SOUP_2019) if has_old_rules else reward
        row[fields.TIMES + number] = layout.time(recipe)
    for x, y in np.ndindex(width, height):
        letter = plan[y][x]
        if letter.isdigit():
            first_number = fields.COOK + _COOK_NUMBERS * (int(letter) - 1)
            row[first_number : first_number + 3] = x, y, fields.UP
        else:
            row[first_cell + x * height + y] = CELLS.index(letter)
    return row


_WORDS = {"o": ("onion", "onions"), "t": ("tomato", "tomatoes")}


def _describe_mission(layout: KitchenLayout, *, has_old_rules: bool) -> str:
    """Return a sentence that says what to cook and how: "cook soups of 3 onions: fill a pot, ..."."""
    if has_old_rules:
        start = "it cooks by itself once it is full"
    else:
        start = "interact with the pot to start it"
    if not layout.orders:
        dish = "any soup"
    else:
        dish = "soups of " + " or of ".join(map(_describe_recipe, layout.orders))
    return f"cook {dish}: fill a pot, {start}, then take the soup with a plate to the serving hatch"


def _describe_recipe(recipe: str) -> str:
    """Return the ingredients of a recipe in words, such as "2 onions and 1 tomato"."""
    ingredients = []
    for letter, (singular, plural) in _WORDS.items():
        count = recipe.count(letter)
        if count:
            ingredients.append(f"{count} {plural if count > 1 else singular}")
    return " and ".join(ingredients)
