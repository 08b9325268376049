"""Tables of stimuli: as spreadsheets write them, with labels, in balanced orders; and wrong ones, found by `check`."""

import io
import random
import re
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest
from PIL import Image

from minihuman.activities.trials.plan import StimuliSpec
from minihuman.activities.trials.stimulus_table import read_table
from minihuman.activities.trials.trial_order import find_longest_run
from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.random_streams import draw_permutation
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.worlds.adapters.world import World
from tests.counts import count

TOML = """
[study]
name = "trials"
version = "1"
seed = 5
[keys]
pool = ["f", "j"]
[[groups]]
name = "all"
blocks = ["words"]
[[blocks]]
name = "words"
kind = "trials"
world = "minihuman/Stimulus-v0"
episodes = {episodes}
actions = ["left", "right"]
noop_action = "none"
response_deadline_ms = 1000
max_steps = 1
stimuli = {{ file = "words.csv"{more} }}
"""
TABLE = "text,colour,correct,side,size,congruent,soa\nL,red,left,left,0.2,yes,100\nR,#00ff00,right,right,0.3,no,0.5\n"
N_MUTANTS = 200


def decode_with_table(table: str | bytes, more: str = "", *, episodes: int = 4) -> Protocol:
    content = table.encode() if isinstance(table, str) else table
    return decode_protocol(TOML.format(more=more, episodes=episodes).encode(), "p.toml", {"words.csv": content})


def plan_trials(protocol: Protocol, participant: int = 0):
    return expand_protocol(protocol, enrol_participant(protocol, participant)).episodes


def read_cells(table: str | bytes) -> list[dict[str, object]]:
    content = table.encode() if isinstance(table, str) else table
    return [row.cells for row in read_table(StimuliSpec(file="t.csv"), {"t.csv": content})]


def test_a_column_that_the_world_does_not_know_is_a_label_and_never_reaches_it():
    protocol = decode_with_table(TABLE)
    (notice,) = check_worlds(protocol, "p.toml")
    assert notice == "block 'words': its table of stimuli has labels, which are not shown: congruent, soa"
    for episode in plan_trials(protocol):
        assert set(episode.labels) == {"congruent", "soa"}
        assert not set(episode.labels) & set(episode.options)
    assert {(episode.options["text"], episode.labels["congruent"]) for episode in plan_trials(protocol)} == {
        ("L", "yes"),
        ("R", "no"),
    }


def test_a_label_is_read_without_the_spaces_around_it():
    protocol = decode_with_table("text,congruent\nL,yes \nR, yes\n")
    assert {episode.labels["congruent"] for episode in plan_trials(protocol)} == {"yes"}


@pytest.mark.parametrize(
    "written",
    [
        "\ufefftext;size;soa\r\nL;0,25;-1,5\r\nR;0,3;2\r\n".encode(),
        b"sep=;\r\ntext;size;soa\r\nL;0,25;-1,5\r\nR;0,3;2\r\n",
        "text\tsize\tsoa\nL\t0,25\t-1,5\nR\t0,3\t2\n".encode("utf-16"),
        b"text;size;soa;;\nL;0,25;-1,5;;\nR;0,3;2;;\n",
        b"text,size,soa\nL,0.25,-1.5\nR,0.3,2\n",
    ],
)
def test_a_table_is_read_as_excel_writes_it(written):
    assert read_cells(written) == [{"text": "L", "size": 0.25, "soa": -1.5}, {"text": "R", "size": 0.3, "soa": 2}]


def test_a_text_with_a_comma_stays_a_text_between_semicolons():
    assert read_cells("text;soa\n3,5;3,5\n") == [{"text": "3,5", "soa": 3.5}]


def test_a_quoted_header_with_a_comma_does_not_hide_the_semicolons():
    assert read_cells('"a,b,c";text\n1;2\n') == [{"a,b,c": 1, "text": 2}]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("text\ngrün\n".encode("cp1252"), r"words\.csv:2: .*not in UTF-8 \(byte 0xFC, 'ü'.*'CSV UTF-8'"),
        ("text,text\nL,R\n", r"words\.csv:1: column 2 is 'text' again"),
        ("text,,side\nL,,left\n", r"words\.csv:1: column 2 has no name"),
        ("text;side,size\nL;left,1\n", r"words\.csv:1: the header has commas and semicolons"),
        ('text,side\nL,left\n"R,right\n', r"words\.csv:\d: this row is not CSV"),
        ("", r"words\.csv:1: there is no header"),
        ("text,size\nL,big\n", r"words\.csv:2: column 'size', value 'big': size is 'big'; use a number"),
        ("text,colour\nL,red\nR,rde\n", r"words\.csv:3: column 'colour', value 'rde': 'rde' is not a colour"),
        ("text,correct\nL,lft\n", r"words\.csv:2: column 'correct', value 'lft': .*left, right, none"),
        ("text,chance_up\nL,0.5\n", r"words\.csv:2: column 'chance_up'.*chance_left"),
        ("text,coluor\nL,red\n", r"words\.csv:1: column 'coluor': .*did you mean 'colour'\?.*labels = \[\"coluor\"\]"),
        ("text,size\nL,1\n,\n", r"words\.csv:3: this row is empty"),
        ("text,times\nL,0.5\n", r"words\.csv:2: column 'times'"),
        ("text,image\nL,face.png\n", r"words\.csv:2: column 'image': it shows 'face.png', which is not in the"),
    ],
)
def test_a_table_that_cannot_be_played_is_refused_with_row_and_column(table, message):
    with pytest.raises(ProtocolError, match=message):
        check_worlds(decode_with_table(table), "p.toml")


def test_every_wrong_row_is_named_and_a_wrong_column_only_until_it_is_clear():
    with pytest.raises(ProtocolError) as refusal:
        check_worlds(decode_with_table("text,size\nL,big\nR,1\nL,small\n"), "p.toml")
    assert re.findall(r"words\.csv:(\d+)", str(refusal.value)) == ["2", "4"]
    with pytest.raises(ProtocolError, match=r"(?s)column 'size', value 'big'.*column 'side', value 'up'"):
        check_worlds(decode_with_table("text,size,side\nL,big,up\n"), "p.toml")
    with pytest.raises(ProtocolError, match="31 more mistakes"):
        check_worlds(decode_with_table("text,size\n" + "".join(f"{row},big\n" for row in range(51))), "p.toml")


def test_a_label_with_the_name_of_an_option_of_the_table_is_allowed_where_the_protocol_says_so():
    protocol = decode_with_table("text,coluor\nL,red\n", ', labels = ["coluor"]')
    check_worlds(protocol, "p.toml")
    assert plan_trials(protocol)[0].labels == {"coluor": "red"}


def test_a_response_that_is_a_number_is_correct_where_the_table_has_the_number():
    toml = TOML.replace('["left", "right"]', '["1", "b"]').replace(
        "max_steps = 1", 'max_steps = 1\noptions = {{ responses = ["1", "b"] }}'
    )
    protocol = decode_protocol(
        toml.format(more="", episodes=2).encode(), "p.toml", {"words.csv": b"text,correct\nL,1\nR,b\n"}
    )
    check_worlds(protocol, "p.toml")
    for episode in plan_trials(protocol):
        with closing(World(episode.world, episode.options)) as world:
            world.reset(1)
            assert world.step(0 if episode.options["correct"] == 1 else 1).reward == 1.0


def test_the_shipped_two_step_task_rewards_at_the_second_choice():
    protocol = read_protocol(find_shipped_protocol("trials/two-step"))
    episode = plan_trials(protocol)[0]
    with closing(World(episode.world, episode.options)) as world:
        world.reset(episode.seed)
        world.step(0)
        assert world.step(0).reward in (0.0, 1.0)


ORDERED = "text,congruent,side\n" + "".join(
    f"{row},{'yes' if row % 4 else 'no'},{'left' if row % 2 else 'right'}\n" for row in range(24)
)


def test_no_level_comes_more_often_in_a_row_than_allowed_and_the_order_is_a_participants_own():
    protocol = decode_with_table(ORDERED, ", max_run = { congruent = 4, side = 3 }", episodes=48)
    orders = [plan_trials(protocol, participant) for participant in range(10)]
    for episodes in orders:
        assert find_longest_run([episode.labels["congruent"] for episode in episodes]) <= 4
        assert find_longest_run([episode.options["side"] for episode in episodes]) <= 3
        for begin in (0, 24):
            assert len({episode.options["text"] for episode in episodes[begin : begin + 24]}) == 24
    assert len({tuple(episode.options["text"] for episode in episodes) for episodes in orders}) == 10
    assert plan_trials(protocol, 3) == orders[3]


def test_part_of_a_table_keeps_each_levels_share():
    protocol = decode_with_table(ORDERED, ', balanced_by = ["congruent"]', episodes=32)
    for participant in range(10):
        counts = Counter(episode.labels["congruent"] for episode in plan_trials(protocol, participant))
        assert counts == {"yes": 24, "no": 8}


def test_an_order_that_there_is_not_is_refused_with_the_way_out():
    with pytest.raises(ProtocolError, match=r"36 of 48 trials have congruent = 'yes'.*allow longer runs"):
        plan_trials(decode_with_table(ORDERED, ", max_run = { congruent = 1 }", episodes=48))
    with pytest.raises(ProtocolError, match="'sides', which is no column of the table; use one of"):
        plan_trials(decode_with_table(ORDERED, ', balanced_by = ["sides"]'))


def test_without_a_wish_for_the_order_the_trials_come_as_they_always_did():
    texts = [episode.options["text"] for episode in plan_trials(decode_with_table(ORDERED))]
    assert texts == list(draw_permutation(24, seed=5, purpose="trials-words-session-1-0")[:4])


def write_picture(path: Path) -> None:
    picture = io.BytesIO()
    Image.new("RGB", (8, 8), "red").save(picture, "PNG")
    path.write_bytes(picture.getvalue())


CELLS = (
    *("", "0", "-1", "nan", "1e400", "007", "true", "left", "yes", "0,5", "face.png", "no.png", "x" * 200, "\u0661"),
    *(
        "a\nb",
        "#12",
        "red",
        "#00ff00",
        " left",
        "\u05db\u05df",
        "9" * 30,
        "=A1",
        "'",
        '"',
        "../x.png",
        "none",
        "ar",
        "\x07",
    ),
)
COLUMNS = (
    *(
        "text",
        "colour",
        "correct",
        "side",
        "size",
        "shape",
        "left",
        "right",
        "image",
        "times",
        "language",
        "sound",
        "Text",
    ),
    *("chance_left", "chance_x", "congruent", "responses", "", "render_mode", "a b", 'q"'),
)


def mutate(seed: int) -> bytes:
    """A table with one to three things in it that are not as they should be."""
    rng = random.Random(seed)
    rows = [line.split(",") for line in TABLE.splitlines()]
    for _ in range(rng.randint(1, 3)):
        match rng.randrange(6):
            case 0:
                row = rng.choice(rows[1:])
                row[rng.randrange(len(row))] = rng.choice(CELLS)
            case 1:
                rows[0][rng.randrange(len(rows[0]))] = rng.choice(COLUMNS)
            case 2:
                rng.choice(rows).append(rng.choice(CELLS))
            case 3:
                rng.choice(rows).pop()
            case 4:
                name = rng.choice(COLUMNS)
                rows = [[*row, name if row is rows[0] else rng.choice(CELLS)] for row in rows]
            case 5:
                rows.insert(1, [rng.choice(CELLS) for _ in rows[0]])
    separator = rng.choice([",", ",", ",", ";", "\t", "|"])
    lines = [separator.join(f'"{c}"' if "\n" in c or separator in c else c for c in row) for row in rows]
    return (
        rng.choice(["\n", "\r\n"]).join(lines).encode(rng.choice(["utf-8", "utf-8-sig", "utf-16", "cp1255"]), "replace")
    )


def check_or_refuse(path: Path) -> tuple[Protocol | None, str]:
    try:
        protocol = read_protocol(path, trust=True)
        check_worlds(protocol, "p.toml")
    except ProtocolError as refusal:
        return None, str(refusal)
    return protocol, ""


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("seed", range(count(25, N_MUTANTS)))
def test_a_mutated_table_is_refused_by_check_or_played_to_its_end(seed, tmp_path):
    (tmp_path / "words.csv").write_bytes(mutate(seed))
    write_picture(tmp_path / "face.png")
    (tmp_path / "p.toml").write_text(TOML.format(more="", episodes=4))
    protocol, refusal = check_or_refuse(tmp_path / "p.toml")
    if protocol is None:
        assert re.search(r"words\.csv:\d+: .*(column|this row|header)", refusal), refusal
        return
    for episode in plan_trials(protocol):
        for action in range(3):
            with closing(World(episode.world, episode.options)) as world:
                world.reset(episode.seed)
                assert world.frame().ndim == 3
                assert world.step(action).terminated
