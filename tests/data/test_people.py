"""The person table: what a laboratory says of its participants reaches tables, queries and notebooks."""

import codecs

import pytest

import minihuman
from minihuman.dataset.participants_file import ParticipantsFileError, read_participants_file
from minihuman.dataset.tables import answer_query, select
from minihuman.errors import ProtocolError, QueryError
from minihuman.experiment.protocol.protocol import decode_logged_protocol, decode_protocol
from minihuman.experiment.protocol.specs import ParticipantColumnSpec
from tests.copied import as_another
from tests.export.study import DEMO, recorded

ABOUT = """
[about]
participant_columns = [
    { name = "age", type = "integer", unit = "year", description = "Age at the session." },
    { name = "score", type = "number", description = "Score of a test." },
    { name = "glasses", type = "boolean", description = "Whether they wore glasses." },
    { name = "hand", description = "The hand at the keys.", levels = { left = "left", right = "right" } },
    { name = "town", description = "Where they come from." },
]
"""
COLUMNS = decode_protocol(DEMO.read_bytes() + ABOUT.encode()).about.participant_columns
HEAD = "participant,age,score,glasses,hand,town\n"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    study = recorded(tmp_path_factory.mktemp("data"), participants=1, toml=DEMO.read_bytes() + ABOUT.encode())
    [log] = study.rglob("*.mcap")
    as_another(log, "sub-02", study)
    (study / "participants.csv").write_text(
        "participant,email,age,score,glasses,hand,town\nsub-02,a@example.org,31,2.50,TRUE,left,NA\nsub-09,,,,,,\n"
    )
    return study


def test_a_query_joins_people_with_what_they_did(study):
    with select(study) as tables:
        answer = answer_query(
            tables,
            "SELECT participant, age, score, glasses, hand, town, episodes FROM people JOIN participants "
            "USING (study, participant) ORDER BY participant",
        )
    assert [tuple(row.values()) for row in answer.to_pylist()] == [
        ("sub-01", None, None, None, None, None, 4),
        ("sub-02", 31, 2.5, True, "left", "NA", 4),
    ]


def test_a_notebook_has_the_table_and_only_declared_columns(study):
    frame = minihuman.open_study(study).table("people")
    assert list(frame.columns) == ["study", "participant", "age", "score", "glasses", "hand", "town"]
    assert frame["age"].tolist()[1] == 31


def test_a_single_log_finds_the_file_of_its_study(study):
    [log] = (study / "sub-02").rglob("*.mcap")
    assert minihuman.open_session(log).table("people")["age"].tolist() == [31]


def test_whom_the_file_does_not_list_is_named(study):
    with select(study) as tables:
        assert tables.people is not None
        assert tables.account.notes == ["participants.csv has no line for sub-01"]


def test_a_study_without_such_columns_has_no_such_table(tmp_path):
    study = recorded(tmp_path, participants=1)
    with select(study) as tables:
        with pytest.raises(QueryError, match="no table 'people'"):
            tables.frame("people")
        with pytest.raises(QueryError, match="Table with name people does not exist"):
            answer_query(tables, "SELECT * FROM people")


def read(folder, content: bytes):
    (folder / "participants.csv").write_bytes(content)
    return read_participants_file(folder, COLUMNS)


@pytest.mark.parametrize(
    "content",
    [
        (HEAD + "sub-01,31,2.5,true,left,Köln\n").encode(),
        codecs.BOM_UTF8 + (HEAD + "sub-01,31,2.5,true,left,Köln\n").encode(),
        (HEAD + "sub-01,31,2.5,TRUE,left,Köln\r\n").replace(",", "\t").encode("utf-16"),
        (HEAD.replace(",", ";") + "sub-01;31;2,5;true;left;Köln\r\n").encode("utf-8-sig"),
        (HEAD + " sub-01 , 31.0 ,+2.5e0,True,left,Köln\n\n").encode("cp1252"),
    ],
    ids=["utf-8", "utf-8 of Excel", "utf-16 with tabs", "semicolons and decimal commas", "cp1252"],
)
def test_the_file_is_read_as_spreadsheets_write_it(tmp_path, content):
    read_file = read(tmp_path, content)
    assert read_file.rows == {"sub-01": {"age": 31, "score": 2.5, "glasses": True, "hand": "left", "town": "Köln"}}


def test_an_assumed_encoding_is_said_with_a_word_to_judge_it_by(tmp_path):
    [note] = read(
        tmp_path, (HEAD + "sub-01,,,,,Łódź".replace("Ł", "£").replace("ź", "Ÿ") + "\n").encode("cp1252")
    ).notes
    assert "was read as Windows-1252, with words such as '£ódŸ'" in note
    assert note.endswith('save the file as "CSV UTF-8"')


@pytest.mark.parametrize("word", ["NA", "n/a", "NaN", "."])
def test_a_word_for_missing_is_missing_but_in_free_text(tmp_path, word):
    rows = read(tmp_path, (HEAD + f"sub-01,{word},{word},{word},{word},{word}\n").encode()).rows
    assert rows["sub-01"] == {"age": None, "score": None, "glasses": None, "hand": None, "town": word}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"participant,age\0,score\n", "is no text in UTF-8: byte 15 is zero; in a spreadsheet, save"),
        (codecs.BOM_UTF16_LE + b"a", "byte 2 is not valid UTF-16"),
        (HEAD.encode() + b"sub-01,,,,,\x81\n", "is not valid UTF-8; in a spreadsheet, save"),
        (b"code,age\n", "has no column 'age'|has no column 'glasses'"),
        (
            HEAD.encode() + b"sub-01,,,,,A,B\n",
            ":2: there are 7 cells under 6 columns; put a text with ','",
        ),
        (HEAD.encode().replace(b"town", b"town,age"), "has two columns 'age'"),
        (HEAD.encode() + b"sub-01,1_0,,,,\n", ":2: age is '1_0'; use a value of type integer"),
        (HEAD.encode() + b"sub-01,,inf,,,\n", ":2: score is 'inf'; use a value of type number"),
        (HEAD.encode() + b"sub-01,,,WAHR,,\n", ":2: glasses is 'WAHR'; use a value of type boolean"),
        (HEAD.encode() + b"sub-01,,,,both,\n", ":2: hand is 'both'; use one of left, right"),
        (HEAD.encode() + b"sub-01,99999999999999999999,,,,\n", ":2: age is '9{20}'; use"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_way_out(tmp_path, content, message):
    with pytest.raises(ParticipantsFileError, match=message):
        read(tmp_path, content)


@pytest.mark.parametrize("name", ["group", "player", "study", "session"])
def test_a_column_of_minihumans_own_name_is_refused_but_in_old_logs(name):
    toml = DEMO.read_bytes() + ABOUT.replace('"age"', f'"{name}"').encode()
    with pytest.raises(ProtocolError, match=f"is '{name}', a column of minihuman's own; call it 'person_{name}' here"):
        decode_protocol(toml)
    assert decode_logged_protocol(toml).about.participant_columns[0].name == name


def test_columns_of_any_names_are_read(tmp_path):
    (tmp_path / "participants.csv").write_text("participant,code,select\nsub-01,A1,B2\n")
    columns = [ParticipantColumnSpec(name=name, description="?") for name in ("code", "select")]
    assert read_participants_file(tmp_path, columns).rows == {"sub-01": {"code": "A1", "select": "B2"}}
