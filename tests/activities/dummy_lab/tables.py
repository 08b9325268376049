from dummy_lab.columns import TAPS
from dummy_lab.events import Tapped
from dummy_lab.rows import TAP_TOPIC

from minihuman.ext import ActivityTable


def build_tap_row(event, log):
    return {"part": event.part + 1, "tap": event.tap}


TAPPING_TABLES = (ActivityTable("taps", TAPS, {Tapped: build_tap_row}, topics=(TAP_TOPIC,)),)
