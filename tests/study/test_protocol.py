import re
from pathlib import Path

import msgspec
import pytest

from minihuman.errors import ProtocolError
from minihuman.study.activities.agent_plan import AgentPlan
from minihuman.study.online import Online
from minihuman.study.protocol import Block, Exclusion, Group, Keys, Protocol, Study, decode

PROTOCOLS = Path(__file__).parents[2] / "protocols"
DEMO = (PROTOCOLS / "demo.toml").read_text()


def broken(old: str, new: str) -> str:
    assert old in DEMO
    with pytest.raises(ProtocolError) as caught:
        decode(DEMO.replace(old, new, 1).encode(), "demo.toml")
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("path", sorted(PROTOCOLS.glob("*.toml")), ids=lambda path: path.name)
def test_shipped_protocols_decode(path):
    protocol = decode(path.read_bytes(), path.name)
    assert protocol.toml == path.read_bytes()


def test_the_papers_study_is_two_groups_of_ten_episodes_a_block_on_keys_one_to_nine():
    protocol = decode((PROTOCOLS / "fourrooms-transfer.toml").read_bytes())
    assert [group.blocks for group in protocol.groups] == [("grid", "first-person"), ("first-person",)]
    assert [block.episodes for block in protocol.blocks] == [10, 10]
    assert [len(block.actions) for block in protocol.blocks] == [3, 3]
    assert protocol.keys.pool == tuple("123456789")
    assert [block.key_map for block in protocol.blocks] == ["fresh", "carry"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("episodes = 2", "episodes = 0", "demo.toml: $.blocks[0].episodes is 0; an episode count is 1 to 10000"),
        ("episodes = 2", "episode = 2", "demo.toml: $.blocks[0].episode is not a field; did you mean 'episodes'?"),
        (
            "episodes = 2",
            "",
            "demo.toml: $.blocks[0] needs the field `episodes`: write a whole number, as in episodes = 10",
        ),
        (
            "episodes = 2",
            'episodes = "2"',
            "demo.toml: $.blocks[0].episodes is '2'; write a whole number, as in episodes = 10",
        ),
        ("seed = 7", "seed = -7", "demo.toml: $.study.seed is -7; a seed is 0 or more"),
        ('name = "demo"', 'name = "De mo"', "demo.toml: $.study.name is 'De mo'; use lower-case"),
        ('"5"]', '"spacebar"]', "demo.toml: $.keys.pool[4] is 'spacebar', which is no key; did you mean 'space'?"),
        ('"5"]', '"4"]', "demo.toml: $.keys.pool[4] is '4' again"),
        ('"5"]', '"escape"]', "demo.toml: $.keys.pool[4] is 'escape', which the session itself uses"),
        ('"2", "3", "4", "5"]', '"2"]', "demo.toml: $.blocks[0].actions has 3 for 2 keys in $.keys.pool"),
        ('"grid", "first-person"]', '"grid", "attic"]', "demo.toml: $.groups[0].blocks[1] is 'attic', which is no"),
        ("[keys]", '[keys]\nspare = "distractor"', "demo.toml: $.blocks[0].distractors is empty"),
        ("episodes = 2", "episodes = 2\nseeds = [1]", "demo.toml: $.blocks[0].seeds has 1 seeds for 2 episodes"),
        ("episodes = 2", "episodes = 2\nseeds = [1, -2]", "demo.toml: $.blocks[0].seeds has a negative seed"),
        ("episodes = 2", 'episodes = 2\npace = "real_time"', "demo.toml: $.blocks[0].step_period_ms is 0.0"),
        (
            "episodes = 2",
            'episodes = 2\npace = "slow"',
            "demo.toml: $.blocks[0].pace is 'slow'; it is one of on_key, real_time",
        ),
        ("{steps}", "{stepps}", "demo.toml: $.blocks[0].feedback has a bad placeholder"),
        ("seed = 7", "seed = 7\nbreak_s = inf", "demo.toml: $.study.break_s is inf; a break is 0 to 86400 s"),
        ("seed = 7", "seed = 7\nbreak_s = nan", "demo.toml: $.study.break_s is nan; a break is 0 to 86400 s"),
        ("[study]", "toml = 1\n[study]", "demo.toml: $.toml is not a field"),
        ("[study]", "[study", "demo.toml: not TOML"),
    ],
)
def test_a_mistake_is_one_line_with_file_path_and_way_out(old, new, message):
    said = broken(old, new)
    assert without_place(said).startswith(message)
    assert "not TOML" in said or re.match(r"demo\.toml:\d+: ", said)


def without_place(said: str) -> str:
    """A message without line and block, which another test looks at."""
    said = re.sub(r"^([\w./-]+\.toml|protocol):\d+: ", r"\1: ", said)
    return re.sub(r"(\$\S+) \((?:block|group|page) '[^']*'\)", r"\1", said)


def test_a_carried_key_map_needs_as_many_actions():
    toml = (PROTOCOLS / "fourrooms-transfer.toml").read_text().replace('["left", "right", "forward"]', '["left"]')
    with pytest.raises(ProtocolError, match=r"\$\.groups\[0\]\.blocks\[1\].* is 'first-person' with 3 actions"):
        decode(toml.encode())


def test_bytes_that_are_no_text_say_so():
    with pytest.raises(ProtocolError, match="byte 0 is not UTF-8"):
        decode(b"\xff", "x.toml")


def documented() -> dict[str, dict[str, str]]:
    sections: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in (PROTOCOLS / "README.md").read_text().splitlines():
        if heading := re.fullmatch(r"##+ `\[+([\w.]+)\]+`", line):
            current = sections.setdefault(heading[1], {})
        elif row := re.match(r"\| `(\w+)` \| .*? \| (.*?) \| ", line):
            current[row[1]] = row[2]
    return sections


@pytest.mark.parametrize(
    ("section", "struct"),
    [
        ("study", Study),
        ("keys", Keys),
        ("groups", Group),
        ("blocks", Block),
        ("blocks.agent", AgentPlan),
        ("exclusions", Exclusion),
        ("web", Online),
    ],
)
def test_the_readme_documents_every_field_and_its_default(section, struct):
    rows = documented()[section]
    fields = msgspec.structs.fields(struct)
    assert list(rows) == [field.name for field in fields]
    for field in fields:
        assert ("required" in rows[field.name]) == field.required, field.name


def test_the_readme_has_a_section_for_every_table_of_the_file():
    tables = {name for name in documented() if "." not in name}
    assert tables == {*Protocol.__struct_fields__} - {"toml", "files"}


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("picture_px = [0, 480]", r"\$\.web\.picture_px is \[0, 480\]; use 16 to 4096 px a side"),
        ("grace_s = -1", r"\$\.web\.grace_s is -1; use 0 to 86400"),
        ('browsers = ["lynx"]', r"\$\.web\.browsers\[0\]"),
        ('codes = { complete = "a b" }', r"\$\.web\.codes\.complete is 'a b'"),
        ('codes = { complete = "C1", declined = "C1" }', r"\$\.web\.codes\.complete is another end's code"),
        ('redirect = "http://example.org"', r"\$\.web\.redirect is .* starts with https://"),
        ('redirect = "https://example.org/{name}"', r"\$\.web\.redirect has a bad placeholder"),
    ],
)
def test_a_mistake_in_the_table_of_the_web_is_said(line, complaint):
    toml = (PROTOCOLS / "demo.toml").read_bytes() + f"\n[web]\n{line}\n".encode()
    with pytest.raises(ProtocolError, match=complaint):
        decode(toml)
