from dummy_lab.events import Tapped
from dummy_lab.plan import TappingPlan
from dummy_lab.screens import TappingScreen

from minihuman.experiment.machine.activity import PartEnding
from minihuman.experiment.machine.inputs import KeyDown
from minihuman.experiment.machine.transitions import Phase
from minihuman.ext import Activity, ActivityKind


class Tapping(Activity):
    phase = Phase.PAGE

    def begin(self):
        self.taps = 0

    def receive(self, happened):
        if not isinstance(happened, KeyDown):
            return
        counts = happened.key == "space" and not happened.repeat
        self.context.emit_key(happened, "accepted" if counts else "unmapped", self.phase)
        if counts:
            self.taps += 1
            self.context.emit(Tapped(self.context.now_ns, self.number, self.taps))
        if self.taps == self.part.plan.taps:
            self.ended = PartEnding()

    def screen(self):
        return TappingScreen(self.context.words.locale, taps=self.taps)

    def simulate(self, choose):
        return "space"


TAPPING = ActivityKind(
    "tapping",
    TappingPlan,
    Tapping,
    messages="dummy_lab.rows:TAPPING_ROWS",
    tables="dummy_lab.tables:TAPPING_TABLES",
    screens=(TappingScreen,),
    report="dummy_lab.report:build_section",
)
