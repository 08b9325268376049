import re
from pathlib import Path

import msgspec
import pytest

from minihuman.activities.agent_blocks.plan import AgentPlan
from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.aliases import FIELD_ALIASES, VALUE_ALIASES, use_current_names
from minihuman.experiment.protocol.protocol import (
    BlockSpec,
    ExclusionSpec,
    GroupSpec,
    KeysSpec,
    Protocol,
    StudySpec,
    decode_protocol,
    list_old_names,
)
from minihuman.experiment.protocol.specs import WebSpec

PROTOCOLS = Path(__file__).parents[2] / "protocols"
DEMO = (PROTOCOLS / "demo.toml").read_text()


def broken(old: str, new: str) -> str:
    assert old in DEMO
    with pytest.raises(ProtocolError) as caught:
        decode_protocol(DEMO.replace(old, new, 1).encode(), "demo.toml")
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("path", sorted(PROTOCOLS.glob("*.toml")), ids=lambda path: path.name)
def test_shipped_protocols_decode(path):
    protocol = decode_protocol(path.read_bytes(), path.name)
    assert protocol.toml == path.read_bytes()


def test_the_papers_study_is_two_groups_of_ten_episodes_a_block_on_keys_one_to_nine():
    protocol = decode_protocol((PROTOCOLS / "fourrooms-transfer.toml").read_bytes())
    assert [group.blocks for group in protocol.groups] == [("grid", "first-person"), ("first-person",)]
    assert [block.episodes for block in protocol.blocks] == [10, 10]
    assert [len(block.actions) for block in protocol.blocks] == [3, 3]
    assert protocol.keys.pool == tuple("123456789")
    assert [block.key_map for block in protocol.blocks] == ["new", "carry_over"]


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
        ('"5"]', '"spacebar"]', "demo.toml: $.keys.pool[4] is 'spacebar', which is not a key; did you mean 'space'?"),
        ('"5"]', '"4"]', "demo.toml: $.keys.pool[4] is '4' again"),
        ('"5"]', '"escape"]', "demo.toml: $.keys.pool[4] is 'escape', which the session itself uses"),
        ('"2", "3", "4", "5"]', '"2"]', "demo.toml: $.blocks[0].actions has 3 for 2 keys in $.keys.pool"),
        ('"grid", "first-person"]', '"grid", "attic"]', "demo.toml: $.groups[0].blocks[1] is 'attic', which is no"),
        ("[keys]", '[keys]\nspare_keys = "distractor"', "demo.toml: $.blocks[0].distractors is empty"),
        ("episodes = 2", "episodes = 2\nmotion_ms = 100", "demo.toml: $.blocks[0].motion_ms is for built-in first-per"),
        ("episodes = 2", "episodes = 2\nmotion_ms = -1", "demo.toml: $.blocks[0].motion_ms is -1; use 0 to 1000 ms"),
        ("episodes = 2", "episodes = 2\nseeds = [1]", "demo.toml: $.blocks[0].seeds has 1 seeds for 2 episodes"),
        ("episodes = 2", "episodes = 2\nseeds = [1, -2]", "demo.toml: $.blocks[0].seeds has a seed that is not from 0"),
        ("episodes = 2", 'episodes = 2\npace = "real_time"', "demo.toml: $.blocks[0].step_period_ms is 0.0"),
        (
            "episodes = 2",
            'episodes = 2\npace = "slow"',
            "demo.toml: $.blocks[0].pace is 'slow'; it is one of on_key, real_time",
        ),
        ("{steps}", "{stepps}", "demo.toml: $.blocks[0].feedback has a bad placeholder"),
        ("seed = 7", "seed = 7\nmin_rest_s = inf", "demo.toml: $.study.min_rest_s is inf; a rest is 0 to 86400 s"),
        ("seed = 7", "seed = 7\nmin_rest_s = nan", "demo.toml: $.study.min_rest_s is nan; a rest is 0 to 86400 s"),
        ("[study]", "toml = 1\n[study]", "demo.toml: $.toml is not a field"),
        ("[study]", "[study", "demo.toml: this is not valid TOML"),
    ],
)
def test_a_mistake_is_one_line_with_file_path_and_way_out(old, new, message):
    said = broken(old, new)
    assert without_place(said).startswith(message)
    assert "not valid TOML" in said or re.match(r"demo\.toml:\d+: ", said)


def without_place(said: str) -> str:
    """A message without line and block, which another test looks at."""
    said = re.sub(r"^([\w./-]+\.toml|protocol):\d+: ", r"\1: ", said)
    return re.sub(r"(\$\S+) \((?:block|group|page) '[^']*'\)", r"\1", said)


def test_a_carried_key_map_needs_as_many_actions():
    toml = (PROTOCOLS / "fourrooms-transfer.toml").read_text().replace('["left", "right", "forward"]', '["left"]')
    with pytest.raises(ProtocolError, match=r"\$\.groups\[0\]\.blocks\[1\].* is 'first-person' with 3 actions"):
        decode_protocol(toml.encode())


def test_bytes_that_are_no_text_say_so():
    with pytest.raises(ProtocolError, match="byte 0 is not valid UTF-8"):
        decode_protocol(b"\xff", "x.toml")


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
        ("study", StudySpec),
        ("keys", KeysSpec),
        ("groups", GroupSpec),
        ("blocks", BlockSpec),
        ("blocks.agent", AgentPlan),
        ("exclusions", ExclusionSpec),
        ("web", WebSpec),
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
        ("image_size_px = [0, 480]", r"\$\.web\.image_size_px is \[0, 480\]; use 16 to 4096 px a side"),
        ("reconnect_timeout_s = -1", r"\$\.web\.reconnect_timeout_s is -1; use 0 to 86400"),
        ('allowed_browsers = ["lynx"]', r"\$\.web\.allowed_browsers\[0\]"),
        ('codes = { complete = "a b" }', r"\$\.web\.codes\.complete is 'a b'"),
        ('codes = { complete = "C1", declined = "C1" }', r"\$\.web\.codes\.complete is another end's code"),
        ('redirect = "http://example.org"', r"\$\.web\.redirect is .* starts with https://"),
        ('redirect = "https://example.org/{name}"', r"\$\.web\.redirect has a bad placeholder"),
    ],
)
def test_a_mistake_in_the_table_of_the_web_is_said(line, complaint):
    toml = (PROTOCOLS / "demo.toml").read_bytes() + f"\n[web]\n{line}\n".encode()
    with pytest.raises(ProtocolError, match=complaint):
        decode_protocol(toml)


def _use_old_names(tree: object, table: str = "") -> object:
    """A protocol's tree with every field and value under its old name, where it has one."""
    if isinstance(tree, list):
        return [_use_old_names(one, table) for one in tree]
    if isinstance(tree, str):
        return {now: old for old, now in VALUE_ALIASES.get(table, {}).items()}.get(tree, tree)
    if not isinstance(tree, dict):
        return tree
    if table.endswith(".group_overrides"):
        return {group: _use_old_names(own, table.removesuffix(".group_overrides")) for group, own in tree.items()}
    old_names = {now: old for old, now in FIELD_ALIASES.get(table, {}).items()}
    return {old_names.get(name, name): _use_old_names(own, f"{table}.{name}".lstrip(".")) for name, own in tree.items()}


EVERY_ALIAS = {
    "study": {"name": "aliases", "version": "1", "seed": 1, "min_rest_s": 3.0},
    "keys": {"pool": ["1", "2", "3"], "spare_keys": "distractor", "keyboard_check": False},
    "groups": [{"name": "a", "allocation_ratio": 2}, {"name": "b", "replace_parts": {"read": ""}}],
    "sessions": [
        {"name": "one", "parts": ["read", "ask", "first", "second", "third"]},
        {"name": "two", "parts": ["first", "compare"], "days_after_previous": [1, 2]},
    ],
    "blocks": [
        {
            "name": name,
            "world": "minihuman/MiniGrid-Empty-5x5-v0",
            "episodes": 2,
            "actions": ["left"],
            "max_steps": 10,
            "distractors": ["right"],
            "key_map": key_map,
            "pace": "real_time",
            "step_period_ms": 100.0,
            "noop_action": "done",
            "instructions": "Look.",
            "rest_text": "Rest.",
            "stop_criterion": {"successes": 1, "of": 1},
            "max_episode_s": 10.0,
            "max_block_s": 20.0,
            "inter_trial_interval_ms": 30.0,
            "final_frame_ms": 40.0,
            "show_outcome": True,
            "group_overrides": {"b": {"key_map": "fixed", "fixed_keys": {"1": "left"}, "rest_text": "Sit."}},
        }
        for name, key_map in (("first", "new"), ("second", "carry_over"), ("third", "constant"))
    ],
    "pages": [{"name": "read", "asks_consent": True, "images": ["a.png"], "group_overrides": {}}],
    "questions": [
        {
            "name": "ask",
            "items": [{"name": "age", "kind": "number", "ask": "How old?", "right": 3}],
            "max_attempts": 2,
            "wrong_answer_text": "No.",
            "return_to": "read",
            "on_failure": "end",
            "group_overrides": {},
        }
    ],
    "activities": [{"name": "compare", "kind": "preferences", "settings": {"source": "first"}}],
    "about": {
        "ethics_approvals": ["Board 7"],
        "how_to_acknowledge": "Cite us.",
        "task_description": "Find it.",
        "participant_columns": [
            {"name": "age", "description": "Age.", "type": "integer"},
            {"name": "left_handed", "description": "Left-handed.", "type": "boolean"},
        ],
    },
    "analysis": {
        "primary_measure": "ineffective_share",
        "secondary_measures": ["all_keys_discovered_s"],
        "equivalence_margin": 0.1,
    },
    "exclusions": [
        {"reason": measure, "level": "participant", "measure": measure, "above": 1.0}
        for measure in VALUE_ALIASES["exclusions.measure"].values()
    ],
    "allocation": {"stratify_by": "ask.age", "cut_points": [30.0]},
    "devices": [{"name": "gaze", "plugin": "lsl"}],
    "web": {
        "image_size_px": [320, 240],
        "image_encoding": "jpeg",
        "reconnect_timeout_s": 1.0,
        "idle_timeout_s": 2.0,
        "allowed_browsers": ["firefox"],
        "min_window_size_px": [100, 100],
        "require_keyboard": False,
        "open_access": True,
        "recruitment_platforms": ["sona"],
        "max_concurrent_sessions": 3,
        "completion_codes": {"complete": "X"},
    },
}  # fmt: skip


def test_every_alias_is_read_as_its_present_name():
    old = _use_old_names(EVERY_ALIAS)
    names = use_current_names(old)
    assert names.tree == EVERY_ALIAS
    assert names.conflicts == []
    said = " ".join(path + note for path, note in names.renamed)
    for aliases in [*FIELD_ALIASES.values(), *VALUE_ALIASES.values()]:
        for before, now in aliases.items():
            assert before in said
            assert f"is now called {now!r}" in said or f"is {before!r}, which is now called {now!r}" in said
    assert use_current_names(EVERY_ALIAS).renamed == []
    assert msgspec.convert(names.tree, Protocol) == msgspec.convert(EVERY_ALIAS, Protocol)


def test_an_old_name_is_named_with_its_line_and_so_is_a_mistake_under_it():
    old = DEMO.replace("keyboard_check = true", "check = true")
    assert list_old_names(decode_protocol(old.encode()), "demo.toml") == [
        "demo.toml:12: $.keys.check is now called 'keyboard_check'"
    ]
    assert list_old_names(decode_protocol(DEMO.encode()), "demo.toml") == []
    line = "demo.toml:12: $.keys.check is 3; write true or false, as in keyboard_check = true"
    assert broken("keyboard_check = true", "check = 3") == line


def test_both_names_at_once_are_a_mistake():
    line = "demo.toml:13: $.keys.check is the old name of 'keyboard_check', which is given too; remove it"
    assert broken("keyboard_check = true", "keyboard_check = true\ncheck = true") == line


def test_a_file_with_old_names_is_read_with_a_warning(tmp_path):
    path = tmp_path / "old.toml"
    path.write_text(DEMO.replace("keyboard_check = true", "check = false"))
    with pytest.warns(FutureWarning, match=r"old\.toml:12: \$\.keys\.check is now called 'keyboard_check'"):
        assert not read_protocol(path).keys.keyboard_check


def test_the_readme_lists_every_earlier_name():
    section = (PROTOCOLS / "README.md").read_text().partition("## Earlier names")[2]
    renamed = [*FIELD_ALIASES.values(), *VALUE_ALIASES.values()]
    pairs = {f"`{before}` → `{now}`" for aliases in renamed for before, now in aliases.items()}
    assert {pair for pair in pairs if pair not in section} == set()
