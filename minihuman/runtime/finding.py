"""A finding of `minihuman doctor`: what one check of the machine showed, and whether sessions can run with it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check. ``unfit_because`` is "" if it is good enough or only for the record."""

    name: str
    value: str
    unfit_because: str = ""

    def line(self) -> str:
        """Return the finding as a line for the terminal."""
        verdict = "NOT FIT" if self.unfit_because else "ok"
        return f"{verdict:8} {self.name:22} {self.value}"
