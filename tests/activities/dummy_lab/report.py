from minihuman.ext import CaptionedTable, ReportSection
from minihuman.reporting.template import Table


def build_section(source):
    taps = source.table("taps")
    rows = [(participant, str(len(rows))) for participant, rows in taps.groupby("participant")]
    return ReportSection("Tapping", [CaptionedTable(Table(("participant", "taps"), rows), "Taps of the space bar.")])
