"""The blocks of a TOML text: a table with its header, the tables below it, and the comments that belong to it."""

import re

from minihuman.builder.toml_spans import Section, Spans, Steps, is_below

BlockRun = tuple[Section, Section]  # the first and the last section of a block without others in between

_COMMENT_LINE = re.compile(r"[ \t]*#[^\n]*\n?")
_BLANK_LINES = re.compile(r"\r?\n?(?:[ \t]*\r?\n)*")


def list_runs(spans: Spans, path: Steps) -> list[BlockRun]:
    """Return each uninterrupted run of sections of the table at ``path`` and the tables below it, in the text's order.

    A table has several runs if sections of other tables stand between its own.
    """
    runs: list[list[Section]] = []
    was_inside = False
    for section in spans.sections:
        is_inside = is_below(section.path, path)
        if is_inside and not was_inside:
            runs.append([])
        if is_inside:
            runs[-1].append(section)
        was_inside = is_inside
    return [(run[0], run[-1]) for run in runs]


def find_core(spans: Spans, run: BlockRun) -> tuple[int, int]:
    """Return where a run begins and ends with the comments directly above and below it, without its last line break.

    A comment directly above the next header belongs to that header.
    """
    first, last = run
    index = spans.sections.index(first)
    begin = first.begin
    if index:
        begin = _find_comments(spans.text, first.begin, spans.sections[index - 1].content_end)
    following = spans.sections[spans.sections.index(last) + 1 :]
    limit = len(spans.text)
    if following:
        limit = _find_comments(spans.text, following[0].begin, last.content_end)
    end = last.content_end
    while end < limit and (comment := _COMMENT_LINE.match(spans.text, end)) and comment.end() <= limit:
        end = comment.end()
    return begin, begin + len(spans.text[begin:end].rstrip("\r\n"))


def find_removable_span(spans: Spans, run: BlockRun) -> tuple[int, int]:
    """Return where the text to remove with a run begins and ends.

    It includes the run's comments and the blank lines behind it, or those before it if the run is the text's last.
    """
    begin, end = find_core(spans, run)
    gap = _BLANK_LINES.match(spans.text, end)
    assert gap is not None
    if gap.end() < len(spans.text):
        return begin, gap.end()
    return len(spans.text[:begin].rstrip()), end


def _find_comments(text: str, header_begin: int, limit: int) -> int:
    """Return the position in the text at which the comment lines directly above a header begin, not before ``limit``.

    Without comments, return ``header_begin``, the position of the header's line.
    """
    begin = header_begin
    while begin > limit:
        line_begin = text.rfind("\n", 0, begin - 1) + 1
        if line_begin < limit or not text[line_begin:begin].lstrip().startswith("#"):
            break
        begin = line_begin
    return begin
