"""Contract test of adaptive designs: the same decision from the same history, in JSON values."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.designs import (
    GROUP,
    Design,
    DesignSpec,
    EnrolledParticipant,
    EnrolmentDesign,
    PlayedEpisode,
    make_design,
    make_enrolment_design,
)
from minihuman.experiment.plan.random_streams import make_draw
from minihuman.plugins import load_plugin
from minihuman.testing.checks import require
from minihuman.worlds.hashing import hash64


def check_design(
    make: str | type[Design | EnrolmentDesign],
    settings: Mapping[str, Any] | None = None,
    *,
    n: int = 12,
    seed: int = 0,
) -> None:
    """Ask a design about random histories, twice and in another order, and compare its decisions.

    Args:
        make: The design's registered name, or its class.
        settings: As a protocol has them.
        n: How many episodes or participants there are in the longest history.
        seed: Of the histories.

    Raises:
        ContractError: if a promise is not kept; it says which.
        ProtocolError: if the design refuses the settings.
    """
    made = [_make(make, settings or {}) for _ in range(2)]
    rng = np.random.default_rng(seed)
    if isinstance(made[0], EnrolmentDesign):
        people = [
            EnrolledParticipant(str(rng.choice(["a", "b"])), str(rng.choice(["x", "y"])), round(float(rng.random()), 3))
            for _ in range(n)
        ]
        asked = [_ask_study(made[0], people, length) for length in range(n + 1)]
        again = [_ask_study(made[1], people, length) for length in reversed(range(n + 1))][::-1]
    else:
        asked, history = [], list[PlayedEpisode]()
        for length in range(n + 1):
            asked.append(_ask(made[0], history[:length]))
            options, episode_seed, *_ = asked[-1]
            outcome = str(rng.choice(["goal", "failure", "timeout"]))
            history.append(PlayedEpisode(dict(options), episode_seed or 0, outcome, 3, float(outcome == "goal")))
        again = [_ask(made[1], history[:length]) for length in reversed(range(n + 1))][::-1]
    require(asked == again, "the same history led to another decision; a design draws and keeps nothing of its own")


def _make(make: str | type[Design | EnrolmentDesign], settings: Mapping[str, Any]) -> Design | EnrolmentDesign:
    if not isinstance(make, str):
        require(issubclass(make, Design | EnrolmentDesign), f"{make.__name__} is no Design and no EnrolmentDesign")
        return make(settings)
    spec, kind = DesignSpec(make, dict(settings)), load_plugin(GROUP, make, ProtocolError, what="design")
    return make_enrolment_design(spec) if issubclass(kind, EnrolmentDesign) else make_design(spec)


def _ask(design: Design | EnrolmentDesign, history: list[PlayedEpisode]) -> tuple[Any, ...]:
    assert isinstance(design, Design)
    decided = design.decide(tuple(history), make_draw(1, "check", len(history)))
    require(decided.seed is None or 0 <= decided.seed < 2**63, f"seed is {decided.seed}; use 0 to 2**63 - 1, or None")
    known = _check_estimates(decided.estimates), hash64(decided.posterior)
    return _check_json(dict(decided.options), "options"), decided.seed, decided.stop, *known


def _ask_study(design: EnrolmentDesign | Design, people: list[EnrolledParticipant], length: int) -> tuple[Any, ...]:
    assert isinstance(design, EnrolmentDesign)
    statistics = _check_json(design.compute_statistics(people[:length], {"a": 1, "b": 1}), "statistics")
    decided = design.decide(statistics, "x", make_draw(1, "check", length))
    require(decided.group in ("", "a", "b"), f"group {decided.group!r} is none of the study's")
    return statistics, decided.group, decided.stop, _check_estimates(decided.estimates)


def _check_json(value: dict[str, Any], what: str) -> dict[str, Any]:
    back = json.loads(json.dumps(value, default=repr))
    require(back == value, f"{what} {value!r} are not the same after JSON; use texts, numbers, lists and dicts")
    return value


def _check_estimates(estimates: Mapping[str, float]) -> dict[str, float]:
    finite = all(isinstance(value, int | float) and math.isfinite(value) for value in estimates.values())
    require(finite, f"estimates are {dict(estimates)!r}; use numbers")
    return dict(estimates)
