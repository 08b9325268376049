"""The blocks of a TOML text: a table with its header, the tables below it, and the comments that belong to it."""

import re

from minihuman.builder.toml_spans import Section, Spans, Steps, is_below

BlockRun = tuple[Section, Section]  # the first and the last section of a block without others in between

_COMMENT_LINE = re.compile(r"[ \t]*#[^\n]*\n?")
_BLANK_LINES = re.compile(r"\r?\n?(?:[ \t]*\r?\n)*")


def list_runs(spans: Spans, path: Steps) -> list[BlockRun]:
    """Return each uninterrupted run of a table and the tables below it, in the order of the text."""
    runs: list[list[Section]] = []
    follows = False
    for section in spans.sections:
        belongs = is_below(section.path, path)
        if belongs and not follows:
            runs.append([])
        if belongs:
            runs[-1].append(section)
        follows = belongs
    return [(run[0], run[-1]) for run in runs]


def find_core(spans: Spans, run: BlockRun) -> tuple[int, int]:
    """Return the span of a block with the comments directly above and below it, without the last line break.

    A comment that touches the next header belongs to that.
    """
    first, last = run
    place = spans.sections.index(first)
    begin = first.begin
    if place:
        begin = _find_comments(spans.text, first.begin, spans.sections[place - 1].content_end)
    following = spans.sections[spans.sections.index(last) + 1 :]
    limit = len(spans.text)
    if following:
        limit = _find_comments(spans.text, following[0].begin, last.content_end)
    end = last.content_end
    while end < limit and (comment := _COMMENT_LINE.match(spans.text, end)) and comment.end() <= limit:
        end = comment.end()
    return begin, begin + len(spans.text[begin:end].rstrip("\r\n"))


def cut_block(spans: Spans, run: BlockRun) -> tuple[int, int]:
    """Return the span of a block with the blank lines behind it, or with those before it at the end of the text."""
    begin, end = find_core(spans, run)
    gap = _BLANK_LINES.match(spans.text, end)
    assert gap is not None
    if gap.end() < len(spans.text):
        return begin, gap.end()
    return len(spans.text[:begin].rstrip()), end


def _find_comments(text: str, header_begin: int, limit: int) -> int:
    """Return where the comments begin that stand directly above a header, not before ``limit``."""
    begin = header_begin
    while begin > limit:
        line_begin = text.rfind("\n", 0, begin - 1) + 1
        if line_begin < limit or not text[line_begin:begin].lstrip().startswith("#"):
            break
        begin = line_begin
    return begin
