"""Groups, orders, sessions and keys: what each participant gets, and that it balances over many."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import AllocationError, ProtocolError
from minihuman.experiment.plan.allocation import build_allocation_list, build_latin_square
from minihuman.experiment.plan.dry_run import describe_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.part_names import list_part_names
from minihuman.experiment.protocol.protocol import decode_logged_protocol, decode_protocol
from tests.study.studies import CORRIDOR, plan_of, protocol

TWO_DAYS = read_protocol(Path(__file__).parents[2] / "protocols" / "two-days.toml")
MAIN = {"open", "rooms", "crossing", "lava"}


@pytest.mark.parametrize("count", range(2, 9))
def test_a_latin_square_has_each_at_each_place_and_after_each_other_equally_often(count):
    square = build_latin_square(count)
    places = Counter((place, thing) for row in square for place, thing in enumerate(row))
    follows = Counter(pair for row in square for pair in pairwise(row))
    assert len(places) == count * count
    assert len(follows) == count * (count - 1)
    assert len(set(places.values())) == len(set(follows.values())) == 1


def test_a_thousand_participants_balance():
    """Groups 2:1:1, in each of them every order of the square, and every action on every key."""
    slots = build_allocation_list(TWO_DAYS)
    assert len(slots) == 1000
    groups = Counter(slot.group for slot in slots)
    assert [round(groups[name] / 250, 1) for name in ("hidden", "shown", "control")] == [2.0, 1.0, 1.0]
    for group, size in groups.items():
        of_group = [slot for slot in slots if slot.group == group]
        orders = Counter(slot.orders for slot in of_group)
        assert len(orders) == 4
        assert max(orders.values()) - min(orders.values()) <= 1, (group, size)
        for action in range(3):
            keys = Counter(slot.kept[action] for slot in of_group)
            assert len(keys) == 6
            assert max(keys.values()) - min(keys.values()) <= 0.12 * size / 6 + 2
    for action in range(3):
        keys = Counter(slot.kept[action] for slot in slots[:996])
        assert set(keys.values()) == {166}


@pytest.mark.parametrize("count", [4, 8, 100])
def test_the_ratio_holds_from_the_beginning(count):
    groups = Counter(slot.group for slot in build_allocation_list(TWO_DAYS)[:count])
    assert groups["hidden"] <= count * 0.5 + 6
    assert abs(groups["hidden"] - groups["shown"] - groups["control"]) <= 6


def test_a_list_made_longer_keeps_the_slots_it_had():
    rest = '[[groups]]\nname = "all"\nparts = ["o"]\n[[orders]]\nname = "o"\nparts = ["corridor", "two"]\n'
    blocks = CORRIDOR + CORRIDOR.replace('"corridor"', '"two"')
    short, long = (build_allocation_list(protocol(rest + blocks, participants=count)) for count in (10, 40))
    assert long[:10] == short


def names_of(index: int, session: int) -> list[str]:
    slot = build_allocation_list(TWO_DAYS)[index]
    return list_part_names(TWO_DAYS, slot, slot.group, session)


@pytest.mark.parametrize("index", range(8))
def test_each_day_has_its_parts(index):
    group = build_allocation_list(TWO_DAYS)[index].group
    first, second = names_of(index, 1), names_of(index, 2)
    how = "how-fixed" if group == "control" else "how"
    assert first[:6] == ["consent", "about-you", how, "quiz", "keyboard_check", "practice"]
    assert first[-2:] == ["load", "until-tomorrow"]
    assert second[:2] == ["again", "keyboard_check"]
    assert set(first[6:10]) == set(second[2:6]) == MAIN
    assert first[6:10] == second[2:6]
    assert second[-2:] == ["load", "goodbye"]


def test_there_is_no_third_day():
    with pytest.raises(AllocationError, match="has 2 sessions, not 3"):
        expand_protocol(TWO_DAYS, enrol_participant(TWO_DAYS, 0), session=3)


@pytest.mark.parametrize("index", range(8))
def test_keys_are_the_same_on_both_days_and_fixed_for_the_control_group(index):
    who = enrol_participant(TWO_DAYS, index)
    days = [expand_protocol(TWO_DAYS, who, session=session) for session in (1, 2)]
    maps = {tuple(sorted(episode.key_map.keys.items())) for plan in days for episode in plan.episodes}
    assert len(maps) == 1
    [its] = maps
    assert {action for _, action in its} == {"left", "right", "forward"}
    shown = {episode.show_keys for plan in days for episode in plan.episodes}
    assert shown == {who.group != "hidden"}
    if who.group == "control":
        assert dict(its) == {"1": "left", "2": "forward", "3": "right"}


def test_layouts_are_new_on_the_second_day():
    who = enrol_participant(TWO_DAYS, 0)
    seeds = [{episode.seed for episode in expand_protocol(TWO_DAYS, who, session=day).episodes} for day in (1, 2)]
    assert not seeds[0] & seeds[1]


def test_orders_of_ones_own_are_drawn_for_each_participant():
    rest = (
        '[[groups]]\nname = "all"\nparts = ["o"]\n'
        '[[orders]]\nname = "o"\norder = "shuffled"\nparts = ["a", "b", "c"]\n'
        + "".join(f'[[pages]]\nname = "{name}"\ntext = "{name}"\n' for name in "abc")
    )
    study = protocol(rest, participants=60)
    orders = Counter(slot.orders[0] for slot in build_allocation_list(study))
    assert len(orders) == 6


def test_a_group_has_texts_of_its_own_and_may_leave_a_part_out():
    rest = (
        '[[groups]]\nname = "x"\nparts = ["t", "u"]\n[[groups]]\nname = "y"\nparts = ["t", "u"]'
        '\nreplace_parts = { u = "" }\n'
        '[[pages]]\nname = "t"\ntext = "for all"\n[pages.group_overrides.y]\ntext = "for y"\n'
        '[[pages]]\nname = "u"\ntext = "u"\n'
    )
    study = protocol(rest)
    plans = {
        plan.participant.group: plan
        for plan in (expand_protocol(study, enrol_participant(study, index)) for index in range(8))
    }
    assert [part.plan.pages for part in plans["x"].parts] == [("for all",), ("u",)]
    assert [part.plan.pages for part in plans["y"].parts] == [("for y",)]


@pytest.mark.parametrize("listed", [["t", "u"], ["o"]])
def test_a_group_may_have_two_parts_in_each_others_place(listed):
    rest = (
        f'[[groups]]\nname = "x"\nparts = {listed}\n[[groups]]\nname = "y"\nparts = {listed}\n'
        'replace_parts = { t = "u", u = "t" }\n[[orders]]\nname = "o"\norder = "fixed"\nparts = ["t", "u"]\n'
        '[[pages]]\nname = "t"\n[[pages]]\nname = "u"\n'
    )
    study = protocol(rest)
    names = {
        group: [part.name for part in expand_protocol(study, enrol_participant(study, 0, group)).parts]
        for group in "xy"
    }
    assert names == {"x": ["t", "u"], "y": ["u", "t"]}


def test_questions_may_come_in_an_order_of_ones_own():
    items = "".join(f'[[questions.items]]\nname = "{n}"\nkind = "text"\nask = "{n}"\n' for n in range(6))
    rest = f'[[questions]]\nname = "q"\nshuffle = true\n{items}'
    orders = {tuple(item.name for item in plan_of(rest, ["q"], index=index).parts[0].plan.items) for index in range(9)}
    assert len(orders) > 6


MISTAKES = {
    "[[groups]]\nname='a'\nparts=['nix']": r"groups\[0\]\.parts\[0\] \(group 'a'\) is 'nix', which is not a part",
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'\nform='tlx'": "is 'tlx'; forms: nasa-tlx",
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'": "needs items, or the name of a form",
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'\nform='nasa-tlx'\nback_to='x'": "back_to .* is 'x'",
    "[[groups]]\nname='a'\nallocation_ratio=0\nparts=['p']\n[[pages]]\nname='p'": (
        r"allocation_ratio \(group 'a'\) is 0; use 1 to 100"
    ),
    "[[groups]]\nname='a'\nparts=['p']\n[[pages]]\nname='p'\n[words.ready]\ntytle='x'": r"words\.ready\.tytle",
    "[[groups]]\nname='a'\n[[sessions]]\nname='s'\nparts=['p']\ncompletion_code='a b'\n[[pages]]\nname='p'": (
        r"completion_code \(session 's'\) is 'a b'; use letters"
    ),
    "[[groups]]\nname='a'\n[[sessions]]\nname='s'\nparts=['p']\ndays_after_previous=[1,2]\n[[pages]]\nname='p'": (
        "first session"
    ),
    "[[groups]]\nname='a'\nparts=['p']\n[[pages]]\nname='p'\n[pages.group_overrides.b]\ntext='x'": "is for no group",
    "[[groups]]\nname='a'\nparts=['p']\n[[pages]]\nname='p'\n[pages.group_overrides.a]\ntxt='x'": "txt",
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'\nitems=[{name='n',kind='number',ask='?',right='12'}]": (
        r"items\[0\]\.right .*is '12', a text, but kind 'number' is answered with a number"
    ),
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'\nitems=[{name='n',kind='text',ask='?',right=12}]": (
        r"items\[0\]\.right .*is 12, a number, but kind 'text' is answered with text"
    ),
    "[[groups]]\nname='a'\nparts=['q']\n[[questions]]\nname='q'\nform='nasa-tlx'\n"
    "[questions.group_overrides.a]\nmax_attempts=0": (
        r"questions\[0\]\.group_overrides\.a\.max_attempts .*is 0; use 1 to 100"
    ),
    "[[groups]]\nname='a'\nparts=['c']\n[[activities]]\nname='c'\nkind='preferences'\nsettings={source='nix'}": (
        r"activities\[0\]\.settings\.source .*is 'nix', which is not a block; blocks: none"
    ),
}


@pytest.mark.parametrize("rest", MISTAKES, ids=range(len(MISTAKES)))
def test_a_mistake_in_a_design_is_one_line_that_names_it(rest):
    with pytest.raises(ProtocolError, match=MISTAKES[rest]) as caught:
        protocol(rest)
    assert "\n" not in str(caught.value)


OF_A_GROUP = {
    "episodes = 0": r"blocks\[0\]\.group_overrides\.all\.episodes \(block 'corridor'\) is 0",
    "seeds = [1, 2]": r"group_overrides\.all\.seeds .*has 2 seeds for 4 episodes",
    'feedback = "{stepz}"': r"group_overrides\.all\.feedback .*has a bad placeholder \('stepz'\)",
    'actions = ["a", "b", "c", "d", "e", "f", "g"]': r"group_overrides\.all\.actions .*has 7 for 6 keys",
    'key_map = "fixed"': r"group_overrides\.all\.fixed_keys .*gives keys to other actions",
}


@pytest.mark.parametrize("own", OF_A_GROUP)
def test_what_is_another_for_a_group_is_held_to_the_same_rules(own):
    with pytest.raises(ProtocolError, match=OF_A_GROUP[own]):
        plan_of(f"{CORRIDOR}[blocks.group_overrides.all]\n{own}\n", ["corridor"])


def test_what_a_group_has_no_use_for_stays_for_the_others():
    own = 'pace = "real_time"\nstep_period_ms = 50\n[blocks.group_overrides.all]\npace = "on_key"\n'
    assert plan_of(CORRIDOR + own, ["corridor"]).episodes[0].pace == "on_key"


@pytest.mark.parametrize("parts", [["corridor", "p", "two"], ["o"]])
def test_a_carried_key_map_needs_as_many_actions_in_lists_of_parts_too(parts):
    two = CORRIDOR.replace('"corridor"', '"two"').replace(', "crash"', "") + 'key_map = "carry_over"\n'
    order = '[[pages]]\nname = "p"\n[[orders]]\nname = "o"\nparts = ["two", "corridor"]\n'
    with pytest.raises(ProtocolError, match=r"\.parts .*has 'two' after 'corridor' .*3 actions carried from 4"):
        plan_of(CORRIDOR + two + order, parts)
    assert plan_of(CORRIDOR + two + order, ["two", "corridor"]).episodes


@pytest.mark.parametrize(
    ("head", "name", "way"),
    [
        ('consent = "I agree."', "consent", "or set asks_consent = true"),
        ('closing = "Bye."', "closing", "or set closing = true"),
        ("[keys]\nkeyboard_check = true", "keyboard_check", "use another name"),
    ],
)
def test_no_part_is_called_what_comes_by_itself(head, name, way):
    text = f'[study]\nname = "s"\nversion = "1"\nseed = 0\n{head}\n[[groups]]\nname = "g"\nparts = ["{name}"]\n'
    toml = f'{text}[[pages]]\nname = "{name}"\n'.encode()
    with pytest.raises(ProtocolError, match=rf"pages\[0\]\.name .*is '{name}'.*{way}"):
        decode_protocol(toml)
    assert decode_logged_protocol(toml).pages[0].name == name  # of a log, which is older than the rule


def test_a_log_s_protocol_that_later_rules_refuse_is_refused_in_order_where_nobody_could_have_played_it():
    two = CORRIDOR.replace('"corridor"', '"two"').replace(', "crash"', "") + 'key_map = "carry_over"\n'
    text = '[study]\nname = "s"\nversion = "1"\nseed = 0\n[[groups]]\nname = "g"\nparts = ["corridor", "two"]\n'
    study = decode_logged_protocol(f"{text}{CORRIDOR}{two}".encode())
    with pytest.raises(ProtocolError, match="3 actions for a key map with 4"):
        expand_protocol(study, enrol_participant(study, 0))
    with pytest.raises(ProtocolError, match="not valid TOML"):
        decode_logged_protocol(b"[study")


def test_a_language_without_words_of_ours_says_what_is_missing():
    with pytest.raises(ProtocolError, match=r"is 'ko', which is none of en, de.*missing, the first is direction"):
        plan_of("[[pages]]\nname='p'\n", ["p"], language="ko")


_LISTS = """
[[groups]]
name = "all"
parts = ["mazes"]
[[orders]]
name = "mazes"
parts = [["a", "load"], ["b", "load"], ["c", "load"]]
[[questions]]
name = "load"
form = "nasa-tlx"
"""


def test_a_latin_square_of_lists_keeps_each_block_with_its_questionnaire():
    blocks = "".join(CORRIDOR.replace('"corridor"', f'"{name}"', 1) for name in "abc")
    study = protocol(_LISTS + blocks, participants=12)
    orders = [list_part_names(study, slot, "all", 1) for slot in build_allocation_list(study)]
    assert all(names[1::2] == ["load"] * 3 for names in orders)
    assert set(Counter(tuple(names[::2]) for names in orders).values()) == {2}  # Williams' six rows for three, twice
    with pytest.raises(ProtocolError, match=r"orders\[0\].parts\[1\]\[1\].*'lode', which is not a part"):
        protocol(_LISTS.replace('["b", "load"]', '["b", "lode"]') + blocks)
    with pytest.raises(ProtocolError, match="names a part twice"):
        protocol(_LISTS.replace('["b", "load"]', '["a"]') + blocks)


@pytest.mark.parametrize(
    ("actions", "said"), [('["left", "right", "forward"]', "toggle"), ('["left", "right", "forward", "toggle"]', "")]
)
def test_a_block_whose_actions_do_not_open_its_doors_is_named(actions: str, said: str) -> None:
    text = f"""
    [study]
    name = "doors"
    version = "1"
    seed = 1
    [[groups]]
    name = "all"
    blocks = ["two"]
    [[blocks]]
    name = "two"
    world = "minihuman/MiniGrid-MultiRoom-N2-S4-v0"
    episodes = 1
    actions = {actions}
    max_steps = 40
    """
    found = list(describe_worlds(decode_protocol(text.encode())))
    assert [said] * bool(said) == [line.split(" uses ")[1].split(",")[0] for line in found]
