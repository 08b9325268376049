"""The functions with which Gymnasium makes the catalogue's grid worlds, from above or seen from inside.

The renderer is imported only for views from inside, since it takes a second to load.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.env import GridEnv, GridEnvOnScreen
from minihuman.worlds.grid.layouts.drawn_level import DrawnLevel
from minihuman.worlds.grid.layouts.go_to_obj import GoToObjGrid


def make_grid_world(family: str, **options: Any) -> Any:
    """Make a world of a family or a level; ``view="first_person"`` shows it from inside, in 3D."""
    is_seen_from_above = options.get("view", "grid") == "grid"
    world_class = GridEnvOnScreen if is_seen_from_above and options.get("render_mode") == "human" else GridEnv
    return make_with_view(partial(world_class, family), **options)


def make_go_to_obj_world(**options: Any) -> Any:
    """Make the grid world of the transfer pair; ``view`` is as in `make_grid_world`."""
    return make_with_view(GoToObjGrid, **options)


def make_drawn_level(**options: Any) -> Any:
    """Make a level from a diagram; ``view`` is as in `make_grid_world`."""
    return make_with_view(DrawnLevel, **options)


def make_with_view(grid: Callable[..., GridEngine], *, view: str = "grid", **options: Any) -> Any:
    """Make a grid world, seen from above or from inside.

    Args:
        grid: a function that makes the world.
        view: "grid" to see it from above, "first_person" from inside.
        options: the arguments of ``grid``, and from inside the size of observations, obs_width and obs_height.

    Raises:
        WorldError: if the view is unknown.
    """
    if view == "grid":
        return grid(**options)
    from minihuman.worlds.inside.env import view_first_person  # here, as the renderer takes a second to load

    picture = {name: options.pop(name) for name in ("obs_width", "obs_height") if name in options}
    return view_first_person(grid(**options), view, **picture)


for _make in (make_go_to_obj_world, make_drawn_level):
    vars(_make)["metadata"] = GridEngine.metadata  # Gymnasium reads there which render modes it has to add
vars(make_grid_world)["metadata"] = GridEnvOnScreen.metadata
