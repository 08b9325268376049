"""Every interface that a plug-in implements or builds on, under one import path that stays the same between versions.

Each name is imported when it is first used, so that a window needs no PyTorch and a learner no window.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from minihuman.activities.questions.question import (
        AnswerDraft as AnswerDraft,
        QuestionKind as QuestionKind,
    )
    from minihuman.agents.agent import BaseAgent as BaseAgent
    from minihuman.dataset.activity_tables import ActivityTable as ActivityTable
    from minihuman.dataset.episode_columns import EpisodeColumn as EpisodeColumn
    from minihuman.dataset.included_episodes import (
        IncludedEpisode as IncludedEpisode,
        IncludedEpisodes as IncludedEpisodes,
    )
    from minihuman.dataset.table_columns import TableColumn as TableColumn
    from minihuman.display.windows.window import (
        Clock as Clock,
        ScriptedWindow as ScriptedWindow,
        VirtualClock as VirtualClock,
        Window as Window,
    )
    from minihuman.experiment.machine.activity import (
        Activity as Activity,
        ActivityKind as ActivityKind,
        RequestHandler as RequestHandler,
    )
    from minihuman.experiment.machine.screens import (
        ActivityScreen as ActivityScreen,
        FilmsScreen as FilmsScreen,
        PageView as PageView,
    )
    from minihuman.experiment.plan.designs import (
        Design as Design,
        DesignDecision as DesignDecision,
        EnrolledParticipant as EnrolledParticipant,
        EnrolmentDecision as EnrolmentDecision,
        EnrolmentDesign as EnrolmentDesign,
        PlayedEpisode as PlayedEpisode,
    )
    from minihuman.experiment.plan.session_plan import PartPlan as PartPlan
    from minihuman.exporters.exporter import ExportResult as ExportResult
    from minihuman.learn.teaching.learner import (
        Learner as Learner,
        LearningRequest as LearningRequest,
        LearningResult as LearningResult,
    )
    from minihuman.log.codec import EventRow as EventRow
    from minihuman.reporting.activity_sections import (
        CaptionedTable as CaptionedTable,
        ReportSection as ReportSection,
        SectionSource as SectionSource,
    )
    from minihuman.reporting.study_measures import StudyMeasure as StudyMeasure
    from minihuman.runtime.devices.device import Device as Device, DeviceSample as DeviceSample
    from minihuman.simulation.participant import KeyPress as KeyPress, SimulatedParticipant as SimulatedParticipant
    from minihuman.worlds.contract import NativeWorld as NativeWorld

_MODULES = {
    "Activity": "minihuman.experiment.machine.activity",
    "ActivityKind": "minihuman.experiment.machine.activity",
    "ActivityScreen": "minihuman.experiment.machine.screens",
    "ActivityTable": "minihuman.dataset.activity_tables",
    "AnswerDraft": "minihuman.activities.questions.question",
    "BaseAgent": "minihuman.agents.agent",
    "CaptionedTable": "minihuman.reporting.activity_sections",
    "Clock": "minihuman.display.windows.window",
    "Design": "minihuman.experiment.plan.designs",
    "DesignDecision": "minihuman.experiment.plan.designs",
    "Device": "minihuman.runtime.devices.device",
    "DeviceSample": "minihuman.runtime.devices.device",
    "EnrolledParticipant": "minihuman.experiment.plan.designs",
    "EnrolmentDecision": "minihuman.experiment.plan.designs",
    "EnrolmentDesign": "minihuman.experiment.plan.designs",
    "EpisodeColumn": "minihuman.dataset.episode_columns",
    "EventRow": "minihuman.log.codec",
    "ExportResult": "minihuman.exporters.exporter",
    "FilmsScreen": "minihuman.experiment.machine.screens",
    "IncludedEpisode": "minihuman.dataset.included_episodes",
    "IncludedEpisodes": "minihuman.dataset.included_episodes",
    "KeyPress": "minihuman.simulation.participant",
    "Learner": "minihuman.learn.teaching.learner",
    "LearningRequest": "minihuman.learn.teaching.learner",
    "LearningResult": "minihuman.learn.teaching.learner",
    "NativeWorld": "minihuman.worlds.contract",
    "PageView": "minihuman.experiment.machine.screens",
    "PartPlan": "minihuman.experiment.plan.session_plan",
    "PlayedEpisode": "minihuman.experiment.plan.designs",
    "QuestionKind": "minihuman.activities.questions.question",
    "ReportSection": "minihuman.reporting.activity_sections",
    "RequestHandler": "minihuman.experiment.machine.activity",
    "ScriptedWindow": "minihuman.display.windows.window",
    "SectionSource": "minihuman.reporting.activity_sections",
    "SimulatedParticipant": "minihuman.simulation.participant",
    "StudyMeasure": "minihuman.reporting.study_measures",
    "TableColumn": "minihuman.dataset.table_columns",
    "VirtualClock": "minihuman.display.windows.window",
    "Window": "minihuman.display.windows.window",
}
__all__ = list(_MODULES)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'minihuman.ext' has no attribute {name!r}")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
