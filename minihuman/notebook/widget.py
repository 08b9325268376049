"""A world to play in a cell of JupyterLab, marimo, VS Code or Colab, by anywidget (extra `notebook`)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minihuman.errors import MinihumanError
from minihuman.notebook.cell_world import CellWorld, pack_cell_world, read_modules
from minihuman.notebook.played_episodes import PlayedEpisodes
from minihuman.recorded_study import Episode

try:
    import anywidget
    import traitlets
except ModuleNotFoundError as error:
    raise MinihumanError(
        f"{error.name} is not installed, by which worlds are played in a cell; "
        'run: pip install "minihuman-lab[notebook]"'
    ) from error

_HERE = Path(__file__).parent


class WorldWidget(anywidget.AnyWidget):
    """A world in a notebook's cell. Click it, or press Tab, and play by the keys below it.

    Args:
        world: the packed world.
    """

    _esm = _HERE / "cell.js"
    _css = _HERE / "cell.css"
    modules: traitlets.List[Any] = traitlets.List().tag(sync=True)
    pack = traitlets.Bytes().tag(sync=True)
    settings = traitlets.Dict().tag(sync=True)
    played: traitlets.List[Any] = traitlets.List().tag(sync=True)  # the columns of each episode that is over

    def __init__(self, world: CellWorld) -> None:
        settings = {"name": world.id, "seeds": list(map(str, world.seeds)), "view": world.view, "keys": world.keys}
        super().__init__(modules=read_modules(), pack=world.pack, settings=settings, played=[])
        self._received = PlayedEpisodes(world)
        self._count = 0  # the episodes that were replayed

    def _receive(self) -> PlayedEpisodes:
        """Return the played episodes, after replaying them if more have come from the cell since the last call."""
        if len(self.played) != self._count:
            self._received.receive(self.played)
            self._count = len(self.played)
        return self._received

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Return the episodes that are over; each was replayed here, so its evidence is "consistent", not "witnessed".

        Raises:
            PageDataError: if an episode replays differently.
        """
        return self._receive().episodes

    @property
    def episode(self) -> Episode:
        """Return the last episode that is over.

        Raises:
            MinihumanError: if none is over.
        """
        episodes = self.episodes
        if not episodes:
            raise MinihumanError("no episode is over; play one in the cell to its end")
        return episodes[-1]

    def save(self, study: Path | str) -> Path | None:
        """Write the episodes as a participant's log into a study's folder.

        Args:
            study: the folder, which may hold only imported sessions; it is created if it does not exist.

        Returns:
            The log's path; None if the study has these episodes already.

        Raises:
            PageDataError: if nothing was played, or the study has sessions that were not imported.
            LogError: if the log cannot be written.
        """
        return self._receive().save(Path(study))


def widget(
    world: str,
    seed: int | Sequence[int] = 0,
    *,
    view: str = "partial",
    keys: Mapping[str, str] | None = None,
    **options: Any,
) -> WorldWidget:
    """Return a widget in which a person plays a compiled world in a notebook's cell.

    Its ``episode`` is the latest episode, and ``save(folder)`` writes all episodes into a study's folder.

    Args:
        world: a Gymnasium id, of this package or of your own; the prefix ``minihuman/`` is optional.
        seed: the seed of the layout, or several seeds for episodes in this order.
        view: "partial" for what the agent sees, or "full" for all of a grid.
        keys: the action of each key, by `KeyboardEvent.key`, such as ``{"f": "left"}``; None for the usual keys.
        options: keyword arguments of ``gymnasium.make``.

    Raises:
        WorldError: if there is no such world or action, or no page can compute the world.
    """
    if isinstance(seed, int):
        seed = (seed,)
    return WorldWidget(pack_cell_world(world, tuple(seed), view=view, keys=keys, options=options))
