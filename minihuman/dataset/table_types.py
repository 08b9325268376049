"""How cells are written where a format or a reader would take them for something else.

Times have a zone, whole numbers that a double would round are known by name, and texts that a spreadsheet would run as
a formula are guarded by an apostrophe.
"""

import re

import pyarrow as pa
import pyarrow.compute as pc

TIMES = pa.timestamp("us", tz="UTC")
_SEPARATORS = r"^|[;\t\r\n]"  # a cell begins at a semicolon, too, where that is the locale's separator
_FORMULA = re.compile(rf"({_SEPARATORS})('*[=+\-@])")
_NUMBER = re.compile(r"[+-]?[0-9]+([.,][0-9]+)*([eE][+-]?[0-9]+)?")


def parse_times(texts: pa.ChunkedArray | pa.Array) -> pa.ChunkedArray | pa.Array:
    """Convert ISO 8601 texts in UTC to times in microseconds; a missing or empty text is a missing time."""
    return pc.assume_timezone(
        pc.cast(pc.utf8_slice_codeunits(pc.utf8_rtrim(texts, "Z"), 0, 26), pa.timestamp("us")), "UTC"
    )


def guard_text(text: str) -> str:
    """Put an apostrophe before whatever a spreadsheet would run as a formula; plain numbers stay as they are.

    A text that already begins with apostrophes before such a sign gets a further one, so that `unguard_text` returns
    every text.
    """
    if _NUMBER.fullmatch(text):
        return text
    return _FORMULA.sub(r"\1'\2", text)


def unguard_text(text: str) -> str:
    """Return the text that was guarded."""
    return re.sub(rf"({_SEPARATORS})'('*[=+\-@])", r"\1\2", text)


def guard_texts(texts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Guard the texts of a column; each distinct text is looked at once."""
    if isinstance(texts, pa.ChunkedArray):
        texts = texts.combine_chunks()
    unique = texts.unique()
    distinct = unique.to_pylist()
    guarded = [text and guard_text(text) for text in distinct]
    if guarded == distinct:
        return texts
    return pa.array(guarded, pa.string()).take(pc.index_in(texts, unique))
