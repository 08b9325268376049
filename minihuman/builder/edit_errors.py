"""The error of a request that the builder does not carry out."""

from minihuman.builder.messages import EditRefusal
from minihuman.errors import MinihumanError


class EditRefusedError(MinihumanError, ValueError):
    """A request that was not carried out.

    Attributes:
        refusal: the answer that the page receives.
    """

    def __init__(self, refusal: EditRefusal) -> None:
        super().__init__(refusal.message)
        self.refusal = refusal
