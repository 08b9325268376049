"""The table of pages: the time at which each reached the display."""

from minihuman.activities.pages.columns import PAGES
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.experiment.machine.events import PageShown
from minihuman.log import topics
from minihuman.log.model.session_log import SessionLog


def _build_page_row(event: PageShown, log: SessionLog) -> TableRow:
    return {
        "part": event.part + 1,
        "name": log.plan.parts[event.part].name,
        "page": event.page,
        "pages": event.pages,
        "submit_ns": event.submit_ns,
        "flip_ns": event.flip_ns,
    }


PAGE_TABLES = (ActivityTable("pages", PAGES, {PageShown: _build_page_row}, topics=(topics.PAGE,)),)
