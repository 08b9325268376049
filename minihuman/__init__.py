"""minihuman: run people and agents through reinforcement-learning environments, and record everything.

Importing it registers the package's worlds with Gymnasium as `minihuman/<name>`. To inspect recorded data:

    import minihuman

    study = minihuman.open_study("sessions/fourrooms-transfer")
    study.table("episodes")                                 # the included episodes, as a pandas table
    session = study["sub-01"]
    session.episodes[3].path                                # where the agent was: x, y, z, heading
    session.episodes[3].frames()                            # what was shown, rendered again and verified
    session.figure("paths")

Episodes are excluded if they are annotated `exclude`, unfinished, or excluded by the protocol's own rules; pass a
`Selection` to choose otherwise. `run`, `simulate`, `verify`, `export` and `report` do the same as the commands of these
names; for the command line, see `minihuman --help`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from minihuman.moved import support_old_names as _support_old_names
from minihuman.worlds.registration import register_with_gymnasium as _register

if TYPE_CHECKING:
    from minihuman.api import (
        ExportSummary as ExportSummary,
        ReportSummary as ReportSummary,
        VerificationLine as VerificationLine,
        export as export,
        import_page_data as import_page_data,
        open_session as open_session,
        open_study as open_study,
        report as report,
        run as run,
        simulate as simulate,
        verify as verify,
    )
    from minihuman.dataset.selection import Selection as Selection
    from minihuman.errors import MinihumanError as MinihumanError
    from minihuman.log.model.session_log import Segment as Segment
    from minihuman.notebook.widget import widget as widget
    from minihuman.recorded_study import (
        Episode as Episode,
        ReplayedStep as ReplayedStep,
        Session as Session,
        Study as Study,
    )
    from minihuman.worlds.adapters.page_world import verify_actions as verify_actions
    from minihuman.worlds.adapters.pettingzoo import parallel_env as parallel_env
    from minihuman.worlds.grid.layout import observation_to_text as observation_to_text
    from minihuman.worlds.team import make_team as make_team

__version__ = "0.1.0"

_MODULES = {  # where each public name is; imported when it is asked for, so that importing minihuman is fast
    "Episode": "minihuman.recorded_study",
    "ExportSummary": "minihuman.api",
    "MinihumanError": "minihuman.errors",
    "ReplayedStep": "minihuman.recorded_study",
    "ReportSummary": "minihuman.api",
    "Segment": "minihuman.log.model.session_log",
    "Selection": "minihuman.dataset.selection",
    "Session": "minihuman.recorded_study",
    "Study": "minihuman.recorded_study",
    "VerificationLine": "minihuman.api",
    "export": "minihuman.api",
    "import_page_data": "minihuman.api",
    "make_team": "minihuman.worlds.team",
    "observation_to_text": "minihuman.worlds.grid.layout",
    "open_session": "minihuman.api",
    "open_study": "minihuman.api",
    "parallel_env": "minihuman.worlds.adapters.pettingzoo",
    "report": "minihuman.api",
    "run": "minihuman.api",
    "simulate": "minihuman.api",
    "verify": "minihuman.api",
    "verify_actions": "minihuman.worlds.adapters.page_world",
    "widget": "minihuman.notebook.widget",
}
__all__ = [*_MODULES, "__version__"]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'minihuman' has no attribute {name!r}")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_register()
_support_old_names()
