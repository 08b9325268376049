"""minihuman: run people and agents through reinforcement-learning worlds, and keep everything.

It registers our worlds with Gymnasium under ``minihuman/<name>``. To look at what was recorded:

    import minihuman

    study = minihuman.open("sessions/fourrooms-transfer")   # a study; of one log or session's folder, a session
    study.table("episodes")                                 # a table of what counts, as pandas
    session = study["sub-01"]
    session.episodes[3].path                                # where the agent was: x, y, z, heading
    session.episodes[3].frames()                            # what was seen, drawn again and proved equal
    session.figure("paths")

What does not count (marked exclude, not played to an end, left out by the protocol's own rules) is left out; give
``open`` a ``Selection`` to say otherwise. On the command line: ``minihuman --help``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from minihuman.worlds.registration import register_in_time as _register

if TYPE_CHECKING:
    from minihuman.data.selection import Selection as Selection
    from minihuman.errors import MinihumanError as MinihumanError
    from minihuman.notebook.episode import Episode as Episode
    from minihuman.notebook.episode import Moment as Moment
    from minihuman.notebook.session import Session as Session
    from minihuman.notebook.study import Study as Study
    from minihuman.notebook.study import open as open
    from minihuman.recorded.segment import Segment as Segment

__version__ = "0.1.0"
__all__ = ["Episode", "MinihumanError", "Moment", "Segment", "Selection", "Session", "Study", "__version__", "open"]

_PLACES = {  # where each public name is; looked up when it is asked for, so that importing minihuman takes no time
    "Episode": "minihuman.notebook.episode",
    "MinihumanError": "minihuman.errors",
    "Moment": "minihuman.notebook.episode",
    "Segment": "minihuman.recorded.segment",
    "Selection": "minihuman.data.selection",
    "Session": "minihuman.notebook.session",
    "Study": "minihuman.notebook.study",
    "open": "minihuman.notebook.study",
}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _PLACES:
            raise AttributeError(f"module 'minihuman' has no attribute {name!r}")
        return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_register()
