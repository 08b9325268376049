"""Names that have moved: each old name still works, with a warning, and the next version removes it.

A finder creates an empty module for a module that no longer exists; its attributes are taken from the new modules. A
module that still exists forwards the names that left it.
"""

import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

_OLD = "minihuman.experiment.activities"
_NEW = "minihuman.activities"
MOVED_MODULES: dict[str, tuple[str, ...]] = {  # an old name -> the modules among which its contents are now
    _OLD: (_NEW,),
    f"{_OLD}.activity": ("minihuman.experiment.machine.activity",),
    f"{_OLD}.agent_blocks": (
        f"{_NEW}.agent_blocks.activity",
        f"{_NEW}.agent_blocks.events",
        f"{_NEW}.agent_blocks.plan",
        f"{_NEW}.agent_blocks.requests",
        f"{_NEW}.rating.activity",
        f"{_NEW}.rating.events",
        f"{_NEW}.takeover.activity",
    ),
    f"{_OLD}.block_plans": (
        f"{_NEW}.play.plan",
        f"{_NEW}.agent_blocks.plan",
        f"{_NEW}.agent_blocks.rules",
        f"{_NEW}.team.plan",
        f"{_NEW}.team.rules",
        f"{_NEW}.trials.plan",
        "minihuman.experiment.machine.bindings",
    ),
    f"{_OLD}.correction": (
        f"{_NEW}.correction.activity",
        f"{_NEW}.correction.events",
        f"{_NEW}.correction.plan",
        f"{_NEW}.clip_requests",
    ),
    f"{_OLD}.keyboard_check": (
        f"{_NEW}.keyboard_check.activity",
        f"{_NEW}.keyboard_check.plan",
    ),
    f"{_OLD}.pages": (
        f"{_NEW}.pages.activity",
        f"{_NEW}.pages.plan",
        f"{_NEW}.pages.page_reader",
    ),
    f"{_OLD}.play": (
        f"{_NEW}.play.activity",
        f"{_NEW}.play.clocks",
        f"{_NEW}.play.design",
        f"{_NEW}.play.screens",
        f"{_NEW}.play.tally",
    ),
    f"{_OLD}.preferences": (
        f"{_NEW}.preferences.activity",
        f"{_NEW}.preferences.events",
        f"{_NEW}.preferences.plan",
        f"{_NEW}.clip_requests",
        f"{_NEW}.episode_clips",
    ),
    f"{_OLD}.questions": (f"{_NEW}.questions",),
    f"{_OLD}.questions.choice": (f"{_NEW}.questions.choice.draft",),
    f"{_OLD}.questions.free_text": (f"{_NEW}.questions.free_text.draft",),
    f"{_OLD}.questions.likert": (f"{_NEW}.questions.likert.draft",),
    f"{_OLD}.questions.number": (f"{_NEW}.questions.number.draft",),
    f"{_OLD}.questions.question": (f"{_NEW}.questions.question",),
    f"{_OLD}.questions.questionnaire": (
        f"{_NEW}.questions.activity",
        f"{_NEW}.questions.plan",
    ),
    f"{_OLD}.questions.slider": (f"{_NEW}.questions.slider.draft",),
    f"{_OLD}.team_messages": (
        f"{_NEW}.team.messages",
        f"{_NEW}.team.message_events",
    ),
    f"{_OLD}.team_play": (
        f"{_NEW}.team.activity",
        f"{_NEW}.team.debrief",
        f"{_NEW}.team.episode",
        f"{_NEW}.team.events",
        f"{_NEW}.team.requests",
    ),
    f"{_OLD}.trial_block": (
        f"{_NEW}.trials.activity",
        f"{_NEW}.trials.plan",
    ),
    "minihuman.admin.lease": ("minihuman.storage.lease", "minihuman.log.record.session_leases"),
    "minihuman.admin.remote_store": (
        "minihuman.storage.remote_store",
        "minihuman.admin.remote_logs",
        "minihuman.dataset.remote_tables",
    ),
    "minihuman.agents.goal_search": ("minihuman.agents.search_choice",),
    "minihuman.api": ("minihuman.recorded_study",),
    "minihuman.dataset.journal": (
        "minihuman.storage.journal",
        "minihuman.storage.file_journal",
        "minihuman.storage.study_journals",
    ),
    "minihuman.dataset.journal_postgres": ("minihuman.storage.postgres_journal", "minihuman.storage.database"),
    "minihuman.dataset.sessions": ("minihuman.dataset.included_episodes",),
    "minihuman.dataset.store": ("minihuman.dataset.table_queries", "minihuman.dataset.table_database"),
    "minihuman.dataset.table_columns": (
        "minihuman.dataset.measure_columns",
        "minihuman.dataset.session_columns",
        "minihuman.dataset.column_aliases",
        "minihuman.dataset.table_catalogue",
        f"{_NEW}.agent_blocks.columns",
        f"{_NEW}.correction.columns",
        f"{_NEW}.pages.columns",
        f"{_NEW}.play.columns",
        f"{_NEW}.preferences.columns",
        f"{_NEW}.questions.columns",
        f"{_NEW}.rating.columns",
        f"{_NEW}.team.columns",
    ),
    "minihuman.experiment.machine.screen_texts": (
        f"{_NEW}.keyboard_check.screens",
        f"{_NEW}.pages.screens",
        f"{_NEW}.play.screens",
        f"{_NEW}.questions.screens",
        "minihuman.experiment.machine.points",
    ),
    "minihuman.experiment.machine.screens": (f"{_NEW}.correction.screens", f"{_NEW}.preferences.screens"),
    "minihuman.experiment.machine.events": ("minihuman.experiment.machine.event_rules",),
    "minihuman.experiment.machine.session": (
        "minihuman.experiment.pending_session",
        "minihuman.experiment.machine.key_state",
    ),
    "minihuman.experiment.replay": ("minihuman.experiment.session_copy",),
    "minihuman.experiment.plan.expansion": (
        "minihuman.experiment.plan.participant_codes",
        "minihuman.experiment.plan.part_names",
        "minihuman.experiment.plan.part_plans",
    ),
    "minihuman.runtime.team_host": (
        "minihuman.runtime.seat_agents",
        "minihuman.runtime.team_seating",
    ),
    "minihuman.runtime.model_sessions": (
        "minihuman.runtime.model_run",
        "minihuman.runtime.model_window",
    ),
    "minihuman.runtime.simulated_session": (
        "minihuman.runtime.simulated_window",
        "minihuman.simulation.part_simulation",
    ),
    "minihuman.reporting.teaching_section": (f"{_NEW}.agent_blocks.report",),
    "minihuman.reporting.results": (
        "minihuman.reporting.block_measures",
        "minihuman.reporting.block_results",
        "minihuman.reporting.exclusions",
        "minihuman.reporting.within_results",
    ),
    "minihuman.reporting.sections": (
        "minihuman.reporting.instruction_clauses",
        "minihuman.reporting.participant_flow",
        "minihuman.reporting.result_tables",
        "minihuman.reporting.statements",
    ),
    "minihuman.statistics.comparison": (
        "minihuman.statistics.permutation",
        "minihuman.statistics.regroupings",
        "minihuman.statistics.equivalence",
        "minihuman.statistics.t_tests",
        "minihuman.statistics.units",
    ),
    "minihuman.statistics.t_tests": ("minihuman.statistics.equivalence",),
    "minihuman.log.activity_topics": (
        f"{_NEW}.agent_blocks.rows",
        f"{_NEW}.correction.rows",
        f"{_NEW}.preferences.rows",
        f"{_NEW}.rating.rows",
        f"{_NEW}.team.rows",
    ),
    "minihuman.admin.status": ("minihuman.admin.enrolment_flow",),
    "minihuman.admin.verify.log": ("minihuman.admin.verify.study", "minihuman.admin.verify.messages"),
    "minihuman.exporters.flat_observations": ("minihuman.exporters.environment_specs",),
    "minihuman.log.system": ("minihuman.storage.system", "minihuman.storage.durable_files"),
    "minihuman.operating_system": ("minihuman.storage.durable_files", "minihuman.portable_names"),
    "minihuman.workflow": ("minihuman.api",),
}


def find_moved(old_module: str, name: str) -> tuple[str, Any]:
    """Return the new module of a name that an old module had, and the object that has this name.

    Raises:
        AttributeError: if none of the modules that replace ``old_module`` has the name.
    """
    for new_module in MOVED_MODULES[old_module]:
        module = import_module(new_module)
        if hasattr(module, name):
            return new_module, getattr(module, name)
    raise AttributeError(f"module {old_module!r} has no attribute {name!r}")


def _get_moved(old_module: str, name: str) -> Any:
    """Return the object that an old name refers to, and warn the code that uses the old name.

    Only a module's ``__getattr__`` may call this function: the warning names the line that is two calls above.

    Raises:
        AttributeError: if no new module has the name.
    """
    if name.startswith("__"):  # the import system looks up such names, which have not moved
        raise AttributeError(f"module {old_module!r} has no attribute {name!r}")
    new_module, moved_object = find_moved(old_module, name)
    warnings.warn(
        f"{old_module}.{name} is now {new_module}.{name}; the old name goes with the next version",
        DeprecationWarning,
        stacklevel=3,
    )
    return moved_object


def warn_of_old_name(old_name: str, new_name: str) -> None:
    """Warn that a name is old; the warning points to the line that uses it, two calls above this function."""
    warnings.warn(
        f"{old_name} is now {new_name}; the old name goes with the next version", DeprecationWarning, stacklevel=3
    )


def forward_names(module: str) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for the module named ``module``, from which some names have moved."""

    def get(name: str) -> Any:
        return _get_moved(module, name)

    return get


class _MovedModule(ModuleType):
    """An empty module in place of an old one; its attributes come from the modules that replace it."""

    def __getattr__(self, name: str) -> Any:
        return _get_moved(self.__name__, name)


class _MovedLoader(Loader):
    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Create the empty module."""
        return _MovedModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing, because the module has no code."""


class MovedModuleFinder(MetaPathFinder):
    """Finds the old module names, after every finder of files."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the specification of a module that has moved, from its old name; None for any other name."""
        if fullname not in MOVED_MODULES:
            return None
        is_package = any(name.startswith(f"{fullname}.") for name in MOVED_MODULES)
        return ModuleSpec(fullname, _MovedLoader(), is_package=is_package)


def support_old_names() -> None:
    """Register the finder of old module names with the import system."""
    if not any(isinstance(finder, MovedModuleFinder) for finder in sys.meta_path):
        sys.meta_path.append(MovedModuleFinder())
