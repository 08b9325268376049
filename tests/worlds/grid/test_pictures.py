"""Pictures: what is where, at every size, and colours that colour-blind eyes tell apart."""

from itertools import combinations

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import from_text
from minihuman.worlds.grid.object_kinds import Item
from minihuman.worlds.grid.pictures.tiles import OBJECT_COLOURS, UNSEEN


class Drawn(GridWorld):
    def __init__(self, diagram):
        self.diagram = diagram
        lines = diagram.splitlines()
        super().__init__(width=len(lines[0]) // 2, height=len(lines), max_steps=20)

    def layout(self, grid):
        from_text(self.diagram, grid)


def picture(diagram, **options):
    world = Drawn(diagram)
    world.reset(seed=0)
    return world.picture(**options)


@pytest.mark.parametrize("view", ["partial", "full"])
@pytest.mark.parametrize(("size_px", "side"), [((56, 56), 8), ((640, 480), 68), ((3, 3), 1)])
def test_the_picture_is_the_largest_that_fits(view, size_px, side):
    env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0")
    env.reset(seed=0)
    cells = 7 if view == "partial" else 5
    side = max(1, min(size_px) // cells)
    assert env.unwrapped.picture(view=view, size_px=size_px).shape == (cells * side, cells * side, 3)


def tile(image, x, y, side):
    return image[y * side : (y + 1) * side, x * side : (x + 1) * side].astype(int)


@pytest.mark.parametrize("side", [8, 32])
def test_no_two_things_look_alike(side):
    cells = ["  ", "WW", "Fr", "Fb", "Or", "Dr", "Lr", "Kr", "Ky", "Ar", "Br", "Gg", "Vr", ">>", "vv", "<<", "^^"]
    tiles = []
    for cell in cells:
        diagram = (
            f"{cell}    \n      \n    >>" if cell not in (">>", "vv", "<<", "^^") else f"{cell}    \n      \n      "
        )
        tiles.append(tile(picture(diagram, view="full", size_px=(3 * side, 3 * side)), 0, 0, side))
    for (one, first), (other, second) in combinations(zip(cells, tiles, strict=True), 2):
        assert np.abs(first - second).max(axis=-1).mean() > 4, (one, other)


def test_what_the_agent_cannot_see_is_dark_and_what_it_sees_is_lit():
    diagram = "    WW    \n    WW    \n>>  WW    \n    WW    \n    WW    "
    full = picture(diagram, view="full", size_px=(100, 100))
    assert tile(full, 1, 0, 20).mean() > tile(full, 3, 0, 20).mean() + 20
    partial = picture(diagram, view="partial", size_px=(140, 140))
    assert (tile(partial, 3, 2, 20) == UNSEEN).all()  # behind the wall
    assert (tile(partial, 3, 5, 20) != UNSEEN).any()


def test_the_agent_and_what_it_carries_are_drawn_over_where_it_stands():
    world = Drawn(">>Kr  \n      \n      ")
    world.reset(seed=0)
    before = world.picture(view="full", size_px=(96, 96))
    world.step(3)
    held = tile(world.picture(view="full", size_px=(96, 96)), 0, 0, 32)
    assert (held != tile(before, 0, 0, 32)).any()


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("kind", KINDS[2:10])
def test_every_item_can_be_drawn_at_every_size(kind, colour):
    world = Drawn(">>    \n      \n      ")
    world.reset(seed=0)
    item = Item(kind, colour)
    world.layout = lambda grid: (grid.put_agent(0, 0), grid.put(item, 2, 2))
    world.reset(seed=0)
    for side in (1, 5, 24):
        assert world.picture(view="full", size_px=(3 * side, 3 * side)).shape == (3 * side, 3 * side, 3)


USUAL = np.eye(3)
PROTANOPIA = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
)
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)


def lab(rgb, seen_by=USUAL):
    """CIE L*a*b* (D65) of an sRGB colour as an eye sees it; matrices of Machado, Oliveira and Fernandes (2009)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(seen_by @ linear, 0, 1)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ linear / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("eyes", [USUAL, PROTANOPIA, DEUTERANOPIA], ids=["usual", "protanopia", "deuteranopia"])
def test_the_colour_safe_colours_are_told_apart(eyes):
    seen = [lab(np.array(colour) / 255, eyes) for colour in OBJECT_COLOURS["colour-safe"]]
    for (one, first), (other, second) in combinations(zip(COLOURS, seen, strict=True), 2):
        assert np.linalg.norm(first - second) > 15, (one, other)  # a difference of 2 to 3 is just seen


def test_green_and_yellow_differ_under_protanopia_in_both_palettes():
    for colours in (OBJECT_COLOURS[palette] for palette in ("classic", "colour-safe")):  # Minigrid's are what they are
        green, yellow = (lab(np.array(colours[k]) / 255, PROTANOPIA) for k in (1, 4))
        assert np.linalg.norm(green - yellow) > 15


def test_a_marked_cell_is_tinted_wherever_it_is_seen():
    world = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").unwrapped
    world.reset(seed=0)  # the agent looks right from (1, 1)
    before, view = world.frame(tile_px=8), world.frame(view="partial", tile_px=8)
    observed = world.observation()["image"]
    world.cell_marks = {(2, 2): ("yellow", 1.0), (1, 3): ("red", 0.5), (0, 4): ("blue", 0.25)}
    marked = world.frame(tile_px=8)
    yellow, red = (np.array(OBJECT_COLOURS["classic"][COLOURS.index(name)]) for name in ("yellow", "red"))
    assert (marked[16:24, 16:24] == yellow).all()
    np.testing.assert_allclose(marked[24:32, 8:16], before[24:32, 8:16] / 2 + red / 2, atol=0.51)
    changed = (marked != before).any(axis=2).reshape(5, 8, 5, 8).any(axis=(1, 3))
    assert np.argwhere(changed.T).tolist() == [[0, 4], [1, 3], [2, 2]]
    seen = (world.frame(view="partial", tile_px=8) != view).any(axis=2).reshape(7, 8, 7, 8).any(axis=(1, 3))
    assert np.argwhere(seen.T).tolist() == [[4, 5], [5, 6]]  # the third is behind it
    np.testing.assert_array_equal(world.observation()["image"], observed)


def test_marks_are_part_of_the_state_and_end_with_the_episode():
    world = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").unwrapped
    world.reset(seed=0)
    plain, bare = world.state_hash(), world.save()
    world.cell_marks = {(2, 2): ("yellow", 0.5)}
    assert world.state_hash() != plain
    saved, picture = world.save(), world.picture()
    world.reset(seed=0)
    assert not world.cell_marks
    assert world.state_hash() == plain
    world.restore(saved)
    np.testing.assert_array_equal(world.picture(), picture)
    world.restore(bare)
    assert world.state_hash() == plain


@pytest.mark.parametrize(
    "marks", [{(5, 0): ("red", 1)}, {(0, -1): ("red", 1)}, {(0, 0): ("pink", 1)}, {(0, 0): ("red", 2)}]
)
def test_a_mark_that_there_cannot_be_is_refused(marks):
    world = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").unwrapped
    world.reset(seed=0)
    world.cell_marks = marks
    with pytest.raises(WorldError, match="give a cell of the grid, one of red, green"):
        world.frame()
