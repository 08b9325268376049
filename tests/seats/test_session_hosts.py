"""Which hosts a session has: those that the plans of its parts name, as a laboratory's own plan may."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import msgspec

from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.plan.session_plan import PartPlan, PlannedPart
from minihuman.runtime.session_hosts import HostContext, make_session_host
from tests.study.studies import CORRIDOR, plan_of, protocol


@dataclass(frozen=True, slots=True)
class WeatherRequest(ActivityRequest):
    """Asks what the weather is."""


@dataclass(frozen=True, slots=True)
class ScoreRequest(ActivityRequest):
    """Asks for the score so far."""


@dataclass(frozen=True, slots=True)
class Said(ActivityInput):
    """What a host said."""

    text: str


class WeatherHost(RequestHandler):
    """Knows the weather alone."""

    closed: ClassVar[list[str]] = []
    request: ClassVar[type[ActivityRequest]] = WeatherRequest
    text: ClassVar[str] = "rain"

    def __init__(self, context: HostContext) -> None:
        assert context.list_logs() == []

    def answer(self, want: ActivityRequest, play: object, t_ns: int) -> ActivityInput | None:
        """Answer the request that it knows."""
        return Said(t_ns, self.text) if isinstance(want, self.request) else None

    def close(self) -> None:
        """Say that it is closed."""
        self.closed.append(self.text)


class ScoreHost(WeatherHost):
    """Knows the score alone."""

    request = ScoreRequest
    text = "3 to 1"


class WeatherPlan(PartPlan, frozen=True):
    """A part that asks for the weather."""

    host: ClassVar[str] = f"{__name__}:WeatherHost"


class ScorePlan(PartPlan, frozen=True):
    """A part that asks for the score."""

    host: ClassVar[str] = f"{__name__}:ScoreHost"


class ForeignPlan(msgspec.Struct, frozen=True):
    """A plan that is none of ours, and asks for nothing."""


def host_of(folder: Path, *part_plans: msgspec.Struct) -> RequestHandler | None:
    parts = tuple(PlannedPart("lab", f"part-{number}", part_plan) for number, part_plan in enumerate(part_plans))
    plan = msgspec.structs.replace(plan_of(CORRIDOR, ["corridor"]), parts=parts)
    study = protocol(f'[[groups]]\nname = "all"\nparts = ["corridor"]\n{CORRIDOR}')
    return make_session_host(HostContext(study, plan, folder))


def test_each_request_reaches_the_host_that_its_parts_plan_names_and_both_are_closed(tmp_path: Path) -> None:
    host = host_of(tmp_path, WeatherPlan(), ForeignPlan(), ScorePlan(), WeatherPlan())
    assert host is not None
    assert host.answer(ScoreRequest(), None, 7) == Said(7, "3 to 1")
    assert host.answer(WeatherRequest(), None, 8) == Said(8, "rain")
    assert host.answer(ActivityRequest(), None, 9) is None
    WeatherHost.closed.clear()
    host.close()
    assert WeatherHost.closed == ["rain", "3 to 1"], "two parts with one host have it once"


def test_a_session_whose_parts_ask_for_nothing_has_no_host(tmp_path: Path) -> None:
    assert host_of(tmp_path, ForeignPlan(), PartPlan()) is None
