"""How Gymnasium makes the grid worlds of the catalogue: as they are, or seen from inside."""

from collections.abc import Callable
from functools import partial
from typing import Any

from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.transfer import GoToObj


def make(family: str, **options: Any) -> Any:
    """A world of a family or a level; ``view="first_person"`` shows it from inside, in 3D."""
    return seen(partial(GridEnv, family), **options)


def make_go_to_obj(**options: Any) -> Any:
    """The grid's half of the transfer pair; ``view`` as in `make`."""
    return seen(GoToObj, **options)


def seen(grid: Callable[..., GridEngine], *, view: str = "grid", **options: Any) -> Any:
    """A grid world as it is, or seen from inside.

    Raises:
        WorldError: if there is no such view.
    """
    if view == "grid":
        return grid(**options)
    from minihuman.worlds.inside.grid_view import first_person  # here, as the renderer takes a second to load

    picture = {name: options.pop(name) for name in ("obs_width", "obs_height") if name in options}
    return first_person(grid(**options), view, **picture)


for _make in (make, make_go_to_obj):
    vars(_make)["metadata"] = GridEngine.metadata  # where Gymnasium looks which render modes it has to add
