"""The `[model]` table of a protocol: what a language model in a participant's place is shown, and what it may cost."""

from collections.abc import Iterator
from typing import Literal

import msgspec

from minihuman.experiment.protocol.validation_errors import Bound, FieldError, check_bounds

ModelModality = Literal["picture", "text", "both"]


class ModelSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of a language model that takes a participant's place: what it is shown, and what it may cost."""

    modality: ModelModality = "both"
    size_px: tuple[int, int] = (640, 480)  # of the screen's picture, width and height
    history: int = 8  # earlier screens, in words, and answers in each request
    invalid: Literal["retry", "no_op", "end"] = "retry"  # what follows an invalid answer
    retries: int = 2  # number of further requests after an invalid answer, or after a request without an answer
    temperature: float = 0.0
    max_tokens: int = 256  # of an answer
    request_fields: tuple[Literal["temperature", "max_tokens", "max_completion_tokens"], ...] = (
        "temperature",
        "max_tokens",
    )  # settings that a request contains
    unknown: Literal["repeat", "end"] = "repeat"  # what follows a call whose answer was lost by a kill
    timeout_s: float = 120.0  # for an answer
    provider: str = ""  # a label for the provider of the model
    price_prompt: float = 0.0  # per million tokens
    price_completion: float = 0.0
    currency: str = ""
    max_price: float = 0.0  # of a session; 0 for no limit
    max_session_tokens: int = 0
    max_session_s: float = 0.0  # of waiting for answers


_BOUNDS: tuple[Bound, ...] = (
    *(("history", 0, 1_000), ("retries", 0, 100), ("temperature", 0, 10), ("max_tokens", 1, 1_000_000)),
    *(("timeout_s", 1, 86_400), ("price_prompt", 0, 1e6), ("price_completion", 0, 1e6), ("max_price", 0, 1e9)),
    *(("max_session_tokens", 0, 1e12), ("max_session_s", 0, 1e7)),
)


def check_model(model: ModelSpec) -> Iterator[FieldError]:
    """Yield an error for each value of the table [model] that has the right type but is not valid."""
    if not all(64 <= side <= 4096 for side in model.size_px):
        yield "$.model.size_px", f"is {list(model.size_px)}; use 64 to 4096 px a side"
    yield from check_bounds("$.model", model, _BOUNDS)
    if model.max_price and not (model.price_prompt or model.price_completion):
        yield "$.model.max_price", "limits nothing without price_prompt and price_completion; give them"
