"""How cells are written where a format or a reader would take them for something else.

Times have a zone, whole numbers that a double would round are known by name, and texts that a spreadsheet would run as
a formula are guarded by an apostrophe.
"""

import re

import pyarrow as pa
import pyarrow.compute as pc

TIMES = pa.timestamp("us", tz="UTC")
_TIME_LENGTH = len("2026-01-31T12:00:00.123456")  # further digits are below a microsecond
_SEPARATORS = r"^|[;\t\r\n]"  # a cell begins at a semicolon, too, where that is the locale's separator
_FORMULA = re.compile(rf"({_SEPARATORS})('*[=+\-@])")
_NUMBER = re.compile(r"[+-]?[0-9]+([.,][0-9]+)*([eE][+-]?[0-9]+)?")


def parse_times(texts: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray | pa.Array:
    """Convert ISO 8601 texts in UTC to times in microseconds; a missing or empty text is a missing time."""
    to_microseconds = pc.utf8_slice_codeunits(pc.utf8_rtrim(texts, "Z"), 0, _TIME_LENGTH)
    return pc.assume_timezone(pc.cast(to_microseconds, pa.timestamp("us")), "UTC")


def guard_text(text: str) -> str:
    """Put an apostrophe before each part of a text that a spreadsheet would run as a formula; numbers are unchanged.

    If apostrophes already precede the sign of a formula, a further one is added, so that `unguard_text` can restore
    every text.
    """
    if _NUMBER.fullmatch(text):
        return text
    return _FORMULA.sub(r"\1'\2", text)


def unguard_text(text: str) -> str:
    """Return the original of a text that `guard_text` guarded."""
    return re.sub(rf"({_SEPARATORS})'('*[=+\-@])", r"\1\2", text)


def guard_texts(texts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Apply `guard_text` to the texts of a column; missing texts stay missing."""
    if isinstance(texts, pa.ChunkedArray):
        texts = texts.combine_chunks()
    distinct = texts.unique()  # guarded once each, as most columns repeat few texts
    distinct_texts = distinct.to_pylist()
    guarded_texts = [text and guard_text(text) for text in distinct_texts]  # None stays None
    if guarded_texts == distinct_texts:
        return texts
    return pa.array(guarded_texts, pa.string()).take(pc.index_in(texts, distinct))
