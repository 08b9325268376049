"""The page's template: tables, escaping, a lab's own template and style, and no HTML anywhere else."""

import ast
import re
import string
from pathlib import Path

import pytest

import minihuman
from minihuman.errors import ReportError
from minihuman.reporting.participant_flow import FlowSection
from minihuman.reporting.template import AnswerCounts, Table
from tests.report.pages import page
from tests.sources import parse_source

PACKAGE = Path(minihuman.__file__).parent


def test_a_table_of_more_rows_than_anybody_reads_is_folded_up_and_says_how_many_it_has() -> None:
    few = page(skipped=Table(("subject", "n"), [(f"sub-{number}", "4") for number in range(60)]))
    many = page(skipped=Table(("subject", "n"), [(f"sub-{number}", "4") for number in range(61)]))
    assert "<details>" not in few
    assert "<details><summary>61 rows: subject, n</summary><table>" in many
    assert many.count("<tr><td") == 61


def test_a_table_of_more_rows_than_a_browser_shows_at_once_says_where_the_others_are() -> None:
    rows = [(f"sub-{number}", "4") for number in range(2_001)]
    whole, cut = (page(skipped=Table(("subject", "n"), rows[:many])) for many in (2_000, 2_001))
    assert "The first" not in whole
    assert "<p>The first 2000 of 2001 rows; the files in <code>tables</code> have all.</p>" in cut
    assert cut.count("<tr><td") == whole.count("<tr><td") == 2_000


def test_answers_keep_their_counts_in_either_direction_of_writing() -> None:
    told = page(answers=Table(("answers",), [(AnswerCounts((("0.1 [יחידה]", 9), ("<b>", 2)), others=3),)], words=1))
    assert '<td class="word"><bdi>0.1 [יחידה]</bdi> (9), <bdi>&lt;b&gt;</bdi> (2) and 3 others</td>' in told


def test_a_register_that_cannot_be_read_is_said_so() -> None:
    told = page(flow=FlowSection(None))
    assert "Participant flow</h2>" in told
    assert "enrolment log cannot be read" in told


def test_all_that_is_shown_is_escaped() -> None:
    said = "<script>alert(1)</script>"
    told = page(study=said, methods=[said], versions=said, players=[said])
    assert "<script" not in told
    assert told.count("&lt;script&gt;") == 5


def test_a_lab_restyles_the_page_or_a_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "report.css").write_text("body { color: teal }")
    assert "<style>body { color: teal }</style>" in page(tmp_path)
    (tmp_path / "report.html.j2").write_text(
        '{% extends "minihuman/report.html.j2" %}{% block methods %}<p>{{ study }}, as told elsewhere</p>{% endblock %}'
    )
    told = page(tmp_path, methods=["Eight took part."])
    assert "<p>little, as told elsewhere</p>" in told
    assert "Eight took part." not in told
    assert '<h2 id="exclusions">Exclusions</h2>' in told
    assert "teal" in told


@pytest.mark.parametrize(
    ("template", "words"),
    [
        ("{% if %}", "report.html.j2:1: Expected an expression"),
        ("{{ speed }}", "'speed' is undefined"),
        ("{% include 'other.html' %}", "other.html"),
        ("{{ study.__class__.__mro__ }}", "access to attribute '__class__' of 'str' object is unsafe"),
    ],
)
def test_a_template_that_cannot_be_rendered_is_refused_in_one_sentence(
    template: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "report.html.j2").write_text(template)
    with pytest.raises(ReportError) as refused:
        page(tmp_path)
    assert words in str(refused.value)
    assert str(tmp_path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_without_template_and_style_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match=r"contains neither report\.html\.j2 nor report\.css"):
        page(tmp_path)


TAG = re.compile(r"</?(html|head|body|style|title|p|h[1-6]|table|thead|tbody|tr|t[dh]|div|span|a|img|figure|details)\b")


def _texts(tree: ast.Module) -> list[ast.Constant]:
    """The string constants of a module, without its docstrings."""
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings
    ]


def test_no_python_of_the_package_writes_html() -> None:
    found = [
        f"{path.relative_to(PACKAGE)}:{text.lineno}: {text.value[:60]!r}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for text in _texts(parse_source(path))
        if TAG.search(text.value) and any(letter in string.ascii_letters for letter in text.value)
    ]
    assert found == []
