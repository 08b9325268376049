"""Kitchens: Overcooked-AI's layouts as facts, their orders and what each recipe earns and takes.

One letter a cell, rows divided by slashes: X counter, P pot, O onions, T tomatoes, D dishes, S serving hatch, a space
the floor, and a digit where that cook begins. Orders are recipes as letters: "oot" is two onions and a tomato.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from minihuman.errors import WorldError

CELLS = " PXOTDS"  # by terrain number
RECIPES = ("o", "t", "oo", "ot", "tt", "ooo", "oot", "ott", "ttt")


@dataclass(frozen=True, slots=True)
class KitchenLayout:
    """A kitchen's floor plan and orders.

    Args:
        plan: The cells, row by row.
        orders: Recipes that earn something; every recipe if there are none.
        bonus: Those that earn twice as much.
        values: What each order earns, in the order of ``orders``; empty for 20 each.
        times: Steps that each order cooks, likewise; other recipes cook 20 steps.
        per_ingredient: Instead of both: values of an onion and a tomato, times of an onion and a tomato.
    """

    plan: str
    orders: tuple[str, ...] = ("ooo",)
    bonus: tuple[str, ...] = ()
    values: tuple[int, ...] = ()
    times: tuple[int, ...] = ()
    per_ingredient: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        """Refuse a plan that is no kitchen."""
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
        """How many cooks work in it."""
        return sum(map(str.isdigit, self.plan))

    def value(self, recipe: str) -> int:
        """What delivering a soup earns, bonus included."""
        if self.orders and recipe not in self.orders:
            return 0
        onion, tomato, _, _ = self.per_ingredient
        value = onion * recipe.count("o") + tomato * recipe.count("t") or 20
        return (self.values[self.orders.index(recipe)] if self.values else value) * (1 + (recipe in self.bonus))

    def time(self, recipe: str) -> int:
        """How many steps a soup cooks."""
        _, _, onion, tomato = self.per_ingredient
        if self.times and recipe in self.orders:
            return self.times[self.orders.index(recipe)]
        return onion * recipe.count("o") + tomato * recipe.count("t") if onion else 20


_SHARED = (21, 13, 15, 7)  # of the layouts with tomatoes

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
