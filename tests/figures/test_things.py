"""Things in a path figure are told apart by their shapes, and the legend names them."""

from matplotlib.figure import Figure

from minihuman.figures.path_figures import MAX_LEGEND_ENTRIES, build_object_legend, draw_map, get_marker
from minihuman.worlds.pose import Map, Thing


def thing(name: str, colour: str = "#ffff00", x: float = 1.0) -> Thing:
    return Thing(name, x, 1.0, 0.4, colour)


def floor(*things: Thing) -> Map:
    return Map("cell", (0.0, 0.0, 8.0, 8.0), (), things)


def test_a_yellow_key_and_a_yellow_door_have_other_shapes() -> None:
    kinds = [thing(f"yellow {kind}") for kind in ("key", "ball", "box", "locked door", "goal", "chair")]
    assert len({get_marker(one) for one in kinds}) == len(kinds)
    assert get_marker(thing("red door")) == get_marker(thing("yellow locked door"))


def test_each_is_drawn_where_it_is_and_no_larger() -> None:
    ax = Figure().add_subplot()
    draw_map(ax, floor(thing("red key", x=2.0), thing("red ball", x=5.0)))
    drawn = {patch.get_gid(): patch.get_extents() for patch in ax.patches if patch.get_gid()}
    assert set(drawn) == {"thing: red key", "thing: red ball"}
    for name, x in (("thing: red key", 2.0), ("thing: red ball", 5.0)):
        box = drawn[name].transformed(ax.transData.inverted())
        assert x - 0.41 <= box.x0 < x < box.x1 <= x + 0.41


def test_the_legend_names_every_kind_once_but_the_goal() -> None:
    maps = [floor(thing("red key"), thing("green goal")), None, floor(thing("red key"), thing("blue box"))]
    assert [str(entry.get_label()) for entry in build_object_legend(maps)] == ["red key", "blue box"]
    assert len(build_object_legend([floor(*(thing(f"thing {number}") for number in range(40)))])) == MAX_LEGEND_ENTRIES
