from dataclasses import dataclass
from typing import ClassVar

from minihuman.ext import ActivityScreen, PageView


@dataclass(frozen=True, eq=False)
class TappingScreen(ActivityScreen):
    drawing: ClassVar = "dummy_lab.drawing:draw_taps"
    page_view: ClassVar = PageView("taps", "dummy_lab.page_values:build_page_values", "dummy_lab:page.js")
    taps: int
