"""The enrolment log and annotations under damage: each is noticed and named, or without effect."""

import random
from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import (
    FormatDeclared,
    SlotTaken,
    open_enrolment_log,
    read_enrolled,
    read_enrolment_log,
)
from minihuman.admin.enrolment_log import take_slot
from minihuman.dataset.annotations import Annotation, add_annotation, annotations_path, read_annotations
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import AllocationError, LogError, MinihumanError
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, _open_in_file
from tests.builders import session
from tests.counts import count
from tests.lab.test_register import PROTOCOL

AT = "2026-01-06T10:00:00Z"


@pytest.fixture
def log(tmp_path: Path):
    return session(episodes=2, path=tmp_path / "sub-01_ses-01.mcap")


def enrolment_log(folder: Path, participants: int = 6) -> Path:
    for _ in range(participants):
        take_slot(PROTOCOL, folder)
    return folder / ENROLMENT_FILE_NAME


def test_a_torn_annotation_does_not_swallow_the_next(log) -> None:
    add_annotation(log, Annotation("look-again", AT))
    with annotations_path(log.path).open("a") as file:
        file.write('{"tag":"exc')
    add_annotation(log, Annotation("exclude", AT, episode=1))
    assert [mark.tag for mark in read_annotations(log.path)] == ["look-again", "exclude"]


def test_a_line_of_which_a_power_cut_left_the_size_alone_is_passed_over(tmp_path: Path) -> None:
    path = enrolment_log(tmp_path, 2)
    for number in (3, 4):
        with path.open("ab") as file:
            file.write(bytes(200))
        assert len(read_enrolled(tmp_path)) == number - 1
        take_slot(PROTOCOL, tmp_path)
        assert len(read_enrolled(tmp_path)) == number
    whole = path.read_bytes()
    path.write_bytes(bytes(len(whole.splitlines()[1])) + whole[len(whole.splitlines()[1]) :])
    with pytest.raises(LogError, match=r"register\.jsonl:\d: "):
        read_enrolled(tmp_path)


@pytest.mark.parametrize("kind", ["enrolment log", "annotations"])
@pytest.mark.nightly(sample=True)
def test_every_flipped_bit_is_named_or_without_effect(kind: str, tmp_path: Path, log) -> None:
    if kind == "annotations":
        for number in (1, 2, 3):
            add_annotation(log, Annotation("exclude", AT, episode=number, note="the phone {rang}"))
        path, read = annotations_path(log.path), lambda: read_annotations(log.path)
    else:
        path, read = enrolment_log(tmp_path), lambda: (read_enrolment_log(tmp_path), read_withdrawn_codes(tmp_path))
    whole, expected, random_ = path.read_bytes(), read(), random.Random(1)
    named = silent = 0
    for _ in range(count(300, 3_000)):
        place = random_.randrange(len(whole))
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << random_.randrange(8)]) + whole[place + 1 :])
        _open_in_file.cache_clear()
        try:
            assert read() == expected
        except MinihumanError as error:
            named += f"{path.name}:" in str(error)
        else:
            silent += 1
    print(f"\n{kind}: {named} flips named")
    assert named + silent == count(300, 3_000)


@pytest.mark.parametrize("change", [lambda lines: lines[1:], lambda lines: [lines[0], *lines[2:]]])
def test_a_line_that_was_taken_out_is_noticed(tmp_path: Path, change) -> None:
    path = enrolment_log(tmp_path)
    path.write_bytes(b"".join(change(path.read_bytes().splitlines(keepends=True))))
    with pytest.raises(LogError, match=r"register\.jsonl:\d: .* a line before it was changed, added or removed"):
        read_enrolled(tmp_path)


def test_lines_of_before_are_unchained_and_covered_by_the_next(tmp_path: Path) -> None:
    path = enrolment_log(tmp_path, 2)
    _, *lines = path.read_bytes().splitlines()  # earlier versions declared no format
    old = [line.partition(b',"previous"')[0] + b"}\n" for line in lines]
    path.write_bytes(b"".join(old))
    take_slot(PROTOCOL, tmp_path)
    register = open_enrolment_log(tmp_path)
    assert [line.participant for line in read_enrolled(tmp_path)] == ["sub-01", "sub-02", "sub-03"]
    assert register.unchained == 2
    assert [type(line) for line in read_enrolment_log(tmp_path)] == [SlotTaken, SlotTaken, FormatDeclared, SlotTaken]
    path.write_bytes(path.read_bytes().replace(b"sub-01", b"sub-09"))
    with pytest.raises(LogError, match=r"register\.jsonl:3: "):
        read_enrolled(tmp_path)


def test_the_first_line_keeps_older_programs_out_and_is_written_once(tmp_path: Path) -> None:
    first, *others = enrolment_log(tmp_path, 2).read_bytes().splitlines()
    assert first[:60] == b'{"withdrawn":["a newer minihuman wrote this: update yours"],'  # what they show of it
    assert not any(b'"format"' in line for line in others)
    assert read_withdrawn_codes(tmp_path) == frozenset()


def test_an_enrolment_log_of_a_newer_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / ENROLMENT_FILE_NAME).write_bytes(b'{"withdrawn":["update"],"format":3}\n')
    with pytest.raises(
        AllocationError, match=r"register\.jsonl:1: a newer minihuman wrote this entry \(format 3; .* to 2\)"
    ):
        read_enrolled(tmp_path)


def test_a_byte_that_is_no_text_is_named(tmp_path: Path) -> None:
    (tmp_path / ENROLMENT_FILE_NAME).write_bytes(b'{"participant":"sub-\xff1"}\n')
    with pytest.raises(MinihumanError, match=r"register\.jsonl:1: .* cannot be read"):
        read_enrolled(tmp_path)
