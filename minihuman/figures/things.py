"""Things on a map as a reader tells them apart: a shape for each kind, in the thing's own colour, and its name."""

from collections.abc import Iterable

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import PathPatch
from matplotlib.transforms import Affine2D

from minihuman.figures.style import WALL
from minihuman.worlds.pose import Map, Thing

MOST_NAMED = 16  # things in a legend
_SHAPES = {  # by the last word of a thing's name
    "ball": "o", "box": "s", "key": "^", "door": "D", "goal": "*", "lava": "X", "duckie": "v", "sign": "p",
    "medkit": "P", "cone": "<", "barrel": "H", "tree": "d",
}  # fmt: skip
_OTHER = "h"


def shape_of(thing: Thing) -> str:
    """The marker of a thing's kind; doors say in a further word whether they are locked or open."""
    words = thing.name.replace("_", " ").lower().split()
    return next((_SHAPES[word] for word in reversed(words) if word in _SHAPES), _OTHER)


def draw_thing(ax: Axes, thing: Thing) -> None:
    """Draw one thing in its size on the map, whose z runs down the page."""
    style = MarkerStyle(shape_of(thing))
    path = style.get_path().transformed(style.get_transform())
    reach = max(abs(path.get_extents().get_points()).max(), 1e-9)
    size = thing.radius / reach
    place = Affine2D().scale(size, -size).translate(thing.x, thing.z)
    patch = PathPatch(
        path.transformed(place), facecolor=thing.colour, edgecolor=WALL, alpha=0.6, linewidth=0.4, zorder=1
    )
    patch.set_gid(f"thing: {thing.name}")
    ax.add_patch(patch)


def named(maps: Iterable[Map | None]) -> list[Line2D]:
    """The legend's entries: every kind of thing on these maps once, goals aside, which have a mark of their own."""
    seen: dict[tuple[str, str], Line2D] = {}
    for thing in (thing for floor in maps if floor is not None for thing in floor.things):
        key = thing.name, shape_of(thing)
        if thing.name and "goal" not in thing.name and key not in seen:
            seen[key] = Line2D(
                [], [], ls="", marker=key[1], ms=5, mfc=thing.colour, mec=WALL, mew=0.4, alpha=0.6, label=thing.name
            )  # fmt: skip
    return list(seen.values())[:MOST_NAMED]
