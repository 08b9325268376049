"""Errors in translated rules: the record that compiled code makes, and the exception that Python would have raised."""

from minihuman.errors import WorldError

INDEX = 1
OVERFLOW = 2
ZERO_DIVISION = 3
BAD_RANGE = 4
NO_PLACE = 5
OUTSIDE = 6
UNPACK = 7
TOO_MANY = 8
NEGATIVE_SHIFT = 9
NOT_FINITE = 10
WRONG_COLOUR = 11
NO_AGENT = 12

_MESSAGES = {
    INDEX: (IndexError, "index {0} is out of range for {1} elements"),
    OVERFLOW: (OverflowError, "a whole number exceeds 64 bits, or a cell's code 32; use smaller numbers"),
    ZERO_DIVISION: (ZeroDivisionError, "division by zero"),
    BAD_RANGE: (ValueError, "no whole number lies in [{0}, {1}), or the range is over 2**32 - 1 wide"),
    NO_PLACE: (WorldError, "no free cell in the rectangle of {0} x {1} cells; give it a larger rectangle"),
    OUTSIDE: (WorldError, "cell ({0}, {1}) is outside the grid, or what is put there is no code of this world"),
    UNPACK: (ValueError, "{0} values where {1} are wanted, or None"),
    TOO_MANY: (WorldError, "{0} objects are as many as there can be; put fewer"),
    NEGATIVE_SHIFT: (ValueError, "negative shift count {1}"),
    NOT_FINITE: (OverflowError, "a number that is not finite, or too large, cannot become a whole number"),
    WRONG_COLOUR: (WorldError, "a colour is none of the six"),
    NO_AGENT: (WorldError, "the agent stands in cell ({0}, {1}), which is no cell of the grid, or looks nowhere"),
}


def error_of(kind: int, first: int, second: int, place: str) -> Exception:
    """Return the exception for a recorded fault.

    Args:
        kind: the number of the kind of error, such as `INDEX`.
        first: the first number that the message mentions.
        second: the second number that the message mentions.
        place: the file and line in the author's source.
    """
    error, message = _MESSAGES.get(kind, (WorldError, "the compiled rules failed"))
    return error(f"{place}: {message.format(first, second)}")
