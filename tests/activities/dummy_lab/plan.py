from minihuman.ext import PartPlan


class TappingPlan(PartPlan, frozen=True, forbid_unknown_fields=True):
    taps: int = 3
