"""Texts of a protocol that programs which guess types, such as pandas, R and Excel, misread.

The tables keep them as they are, and every format that has types says that they are text. A reader of CSV loses them
unless it is told, so `minihuman check` names them before data are taken.
"""

import re
from collections.abc import Iterator

from minihuman.experiment.plan.dry_run import list_missing_words
from minihuman.experiment.protocol.protocol import Protocol

_MISSING_WORDS = frozenset(  # of pandas; R and readr have NA, Polars and DuckDB have NULL
    ("#N/A", "#NA", "-NaN", "-nan", "<NA>", "N/A", "NA", "NULL", "NaN", "None", "n/a", "nan", "null")
)
_BOOLEANS = frozenset({"T", "F", "TRUE", "FALSE", "True", "False", "true", "false"})
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?inf(inity)?", re.IGNORECASE)
# a number that is written in the same way after it was read, such as 1.0
_PLAIN_NUMBER = re.compile(r"-?(0|[1-9][0-9]{0,14})(\.[0-9]*[1-9]|\.0)?")
_MONTH = "(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)"
_DATE = re.compile(rf"[0-9]{{1,4}}[-/.][0-9]{{1,2}}([-/.][0-9]{{1,4}})?|{_MONTH}[- ]?[0-9]{{1,4}}", re.IGNORECASE)
_MAX_NAMED = 6  # texts in a line


def list_text_warnings(protocol: Protocol) -> Iterator[str]:
    """Yield a warning for each interface text without a translation, and for each way in which texts are misread."""
    yield from list_missing_words(protocol)
    yield from list_ambiguous_texts(protocol)


def explain_misreading(text: str) -> str:
    """Return what programs that guess types misread a text as, such as "a date"; "" if they do not misread it."""
    if text in _MISSING_WORDS:
        return "a missing value"
    if text in _BOOLEANS:
        return "true or false"
    if _PLAIN_NUMBER.fullmatch(text):
        return ""
    if _NUMBER.fullmatch(text):
        return "a number"
    if _DATE.fullmatch(text):
        return "a date"
    if re.match(r"[=+\-@]", text):
        return "a formula"
    return ""


def list_ambiguous_texts(protocol: Protocol) -> Iterator[str]:
    """Yield a line for each kind of misreading, with the texts of the protocol that are misread."""
    texts_by_misreading: dict[str, list[str]] = {}
    for place, text in _list_texts(protocol):
        misreading = explain_misreading(text)
        if misreading:
            texts_by_misreading.setdefault(misreading, []).append(f"{place} {text!r}")
    for misreading, texts in texts_by_misreading.items():
        examples = ", ".join(texts[:_MAX_NAMED])
        if len(texts) > _MAX_NAMED:
            examples += f" and {len(texts) - _MAX_NAMED} more"
        yield (
            f"programs that guess types, such as pandas, R and Excel, read as {misreading}: {examples}; use other "
            "words, or read exports as their README says"
        )


def _list_texts(protocol: Protocol) -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each name, version and answer that becomes a cell of a table."""
    yield "study.name", protocol.study.name
    yield "study.version", protocol.study.version
    for group in protocol.groups:
        yield "group", group.name
    for block in protocol.blocks:
        yield "block", block.name
    for questionnaire in protocol.questions:
        for question in questionnaire.items:
            place = f"{questionnaire.name}.{question.name}"
            yield from ((place, code) for code in question.codes if isinstance(code, str))
            yield from ((place, option) for option in question.options)
    for column in protocol.about.participant_columns:
        yield from ((column.name, level) for level in column.levels)
    yield from _list_labels(protocol)


def _list_labels(protocol: Protocol) -> Iterator[tuple[str, str]]:
    """Yield the place, as "BLOCK.COLUMN", and the text of each distinct label of the trials' stimuli."""
    for block in protocol.blocks:
        if block.stimuli is None:
            continue
        cells = {(name, row.get(name)) for row in block.stimuli.rows for name in block.stimuli.labels}
        for name, cell in sorted(cells, key=str):
            if isinstance(cell, str):
                yield f"{block.name}.{name}", cell
