"""A plan's pages: an older log is proven by those it has, if they are the whole text; a new one is divided again."""

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.display.text import PAGINATION_RULES, is_division, paginate_text
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log import topics
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.session_reader import read_log
from tests.promises.sessions import TOML, play, study
from tests.promises.tampering import Record, at, rewritten

pytestmark = pytest.mark.program

[OLD_LOG] = (Path(__file__).parents[1] / "golden/v1/every-part").glob("sub-01/ses-*/*.mcap")
NOT_GIVEN = "segment 1: plan: parts is not what the protocol gives"
LONG_TEXT = "A sentence of the consent that everybody has to read before the first world is shown. " * 30
Pages = list[str]


def with_pages(log: Path, target: Path, change: Callable[[Pages], Pages]) -> Path:
    """A copy of a log with other pages in the plan of its consent, and with a hash chain that is right for them."""

    def change_plan(records: list[Record]) -> None:
        place = at(records, topics.PLAN)
        message = records[place]
        plan = v1.SessionPlan.FromString(message.data)
        [part] = [part for part in plan.parts if part.name == "consent"]
        fields = json.loads(part.plan_json)
        pages = change(fields["pages"])
        assert pages != fields["pages"]
        fields["pages"] = pages
        part.plan_json = json.dumps(fields, separators=(",", ":"), ensure_ascii=False)
        records[place] = message._replace(data=plan.SerializeToString(deterministic=True))

    return rewritten(log, target / log.name, change_plan, chained=True)


def faults(log: Path) -> list[str]:
    """What a proof has against a log, but that the plan's second copy has the pages of before."""
    return [line for line, good in verify_session(log) if not good and "is not a copy of the plan" not in line]


def move_words(pages: Pages) -> Pages:
    """The pages of a machine on which a line less had room on the first."""
    first, second, *others = pages
    place = first.rindex(" ", 0, len(first) - 100) + 1
    return [first[:place], first[place:] + " " * (not first[-1].isspace()) + second, *others]


@pytest.fixture(scope="module")
def new_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = TOML.format(episodes=1, steps=3).replace("I take part of my own free will.", LONG_TEXT.strip())
    protocol = decode_protocol(text.encode())
    return play(tmp_path_factory.mktemp("data"), protocol, sync=lambda _fd: None)


def test_an_older_log_is_proven_with_the_pages_of_another_machine(tmp_path: Path) -> None:
    assert faults(with_pages(OLD_LOG, tmp_path, move_words)) == []


@pytest.mark.parametrize(
    "change",
    [
        lambda pages: [pages[0].swapcase(), *pages[1:]],
        lambda pages: [pages[0], pages[2], pages[1]],
        lambda pages: [pages[0], pages[1], ""],
        lambda pages: [pages[0], pages[1]],
        lambda pages: [*pages[:2], f"{pages[2]} And more."],
        lambda pages: [f" {pages[0]}", *pages[1:]],
        lambda pages: [*pages[:2], pages[1]],
    ],
    ids=["a word", "another order", "a page emptied", "a page less", "more text", "a blank", "a page twice"],
)
def test_an_older_log_whose_pages_are_not_its_text_is_refused(change: Callable[[Pages], Pages], tmp_path: Path) -> None:
    assert NOT_GIVEN in faults(with_pages(OLD_LOG, tmp_path, change))


def test_a_new_log_is_refused_with_any_other_pages(new_log: Path, tmp_path: Path) -> None:
    [consent] = [part.plan for part in read_log(new_log).plan.parts if part.name == "consent"]
    assert len(consent.pages) > 1
    assert consent.pagination == PAGINATION_RULES
    assert faults(new_log) == []
    assert faults(with_pages(new_log, tmp_path, move_words)) == [NOT_GIVEN]


def test_a_text_of_one_page_has_no_rules_in_its_plan() -> None:
    protocol = study(episodes=1, steps=3)
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    assert b"pagination" not in msgspec.json.encode(plan)


@pytest.mark.parametrize(
    ("pages", "text", "pictures", "verdict"),
    [
        (("",), "", 0, True),
        (("one two", "three"), "one two\n\nthree ", 0, True),
        (("one two ", "  - three"), "one two   - three", 0, True),
        (("one", "two", ""), "one two", 0, False),
        (("one two", ""), "one two", 2, True),
        (("one two",), "one two", 2, False),
        (("one", "three"), "one two three", 0, False),
        (("one", "one"), "one", 0, False),
        (("one ", " two"), "one two", 0, False),
        ((" ",), " ", 0, False),
        ((), "", 0, True),
        ((), "one", 0, False),
        (("很长的", "标题"), "很长的标题", 0, True),
    ],
)
def test_pages_are_a_division_of_a_text(pages: tuple[str, ...], text: str, pictures: int, verdict: bool) -> None:
    assert is_division(pages, text, pictures=pictures) is verdict


@pytest.mark.parametrize("pictures", [0, 1, 3])
def test_pages_as_they_are_made_are_a_division(pictures: int) -> None:
    for text in ("", "A word", LONG_TEXT, f"Heading\n\n{LONG_TEXT}\n\n  - item\n- item\n\n{LONG_TEXT * 3}"):
        assert is_division(paginate_text(text, pictures=pictures), text, pictures=pictures)
