"""The types of the builder's page, generated from the structs that it exchanges with its server.

python -m minihuman.builder.message_types     # writes page/messages.d.ts, which is committed
"""

from pathlib import Path
from typing import Any

from minihuman.builder import data_messages, messages, preview_api, preview_server, trial_runs
from minihuman.web.page_types import write_types

PATH = Path(__file__).with_name("page") / "messages.d.ts"
_HEAD = """\
// What the builder's page and its server send each other. Generated: edit minihuman/builder/messages.py, then run
// `python -m minihuman.builder.message_types`.
"""
_FROM_PAGE = (
    messages.EditRequest
    | messages.VersionRequest
    | messages.NewStudyRequest
    | messages.TableRequest
    | data_messages.QueryRequest
    | data_messages.AnnotationRequest
    | data_messages.ExportRequest
    | data_messages.DepartureRequest
    | messages.TrustRequest
    | preview_api.ShowRequest
)
_TO_PAGE = (
    messages.Studies
    | messages.Document
    | messages.FieldForm
    | messages.Kinds
    | messages.CheckReport
    | messages.Media
    | messages.StimulusTable
    | messages.Differences
    | messages.EditRefusal
    | data_messages.RecordedData
    | data_messages.SessionDetails
    | messages.CopiedFile
    | messages.TrustQuestion
    | data_messages.EpisodeReplay
    | data_messages.Departure
    | data_messages.QueryAnswer
    | data_messages.DataExport
    | preview_server.Preview
    | preview_api.PageInfo
    | preview_api.WorldInfo
    | trial_runs.SimulationRun
)
_ALIASES: dict[str, Any] = {"FromPage": _FROM_PAGE, "ToPage": _TO_PAGE}


def format_builder_types() -> str:
    """Return the text of `page/messages.d.ts`, the TypeScript types of all messages."""
    return _HEAD + "\n" + write_types(_ALIASES, _FROM_PAGE)


if __name__ == "__main__":
    PATH.write_text(format_builder_types(), encoding="utf-8", newline="\n")
