"""Mistakes that people make in TOML: each is told with its line, its block, its value and the way out, all at once."""

import re

import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.validation_errors import TomlLines

GOOD = """\
[study]
name = "tiny"
version = "1"
seed = 4
participants = 20
consent = \"\"\"
[not a table]
key = "and no key"
\"\"\"

[keys]
pool = ["1", "2",
  "3", "4"]

[[groups]]
name = "early"
blocks = ["g", "h"]

[[groups]]
name = "late"
blocks = ["h", "g"]

[[blocks]]
name = "g"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 3
actions = ["left", "right", "forward"]
max_steps = 50
seeds = "new"
key_map = "new"
feedback = "{outcome}"

[[blocks]]
name = "h"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
pace = "real_time"
step_period_ms = 300.0

[[exclusions]]
reason = "slow"
level = "episode"
measure = "steps"
above = 40.0
"""

# old, new (at its last place), then what is said: line, and words of place, value and way out
MISTAKES = [
    ('seed = 4', 'seeed = 4', 4, ["$.study.seeed", "did you mean 'seed'?"]),
    ('seed = 4\n', '', 1, ["$.study", "needs the field `seed`", "seed = 10"]),
    ('seed = 4', 'seed = 1.5', 4, ["$.study.seed", "1.5", "a whole number"]),
    ('seed = 4', 'seed = "four"', 4, ["'four'", "a whole number"]),
    ('seed = 4', 'seed = -4', 4, ["-4", "0 or more"]),
    ('seed = 4', 'seed = true', 4, ["is true", "a whole number"]),
    ('version = "1"', 'version = 1', 3, ["$.study.version", "is 1", "a text in quotes"]),
    ('name = "tiny"', 'name = "Tiny Study"', 2, ["'Tiny Study'", "lower-case"]),
    ('participants = 20', 'participants = 0', 5, ["is 0", "1 to 100000"]),
    ('participants = 20', 'participants = "20"', 5, ["'20'", "participants = 10"]),
    ('participants = 20', 'participants = 20\nmin_rest_s = "long"', 6, ["'long'", "a number, as in min_rest_s = 1.5"]),
    ('participants = 20', 'participants = 20\nmin_rest_s = -1.0', 6, ["-1.0", "0 to 86400 s"]),
    ('[study]', '[sutdy]', 1, ["$.sutdy", "did you mean 'study'?"]),
    ('[keys]', '[[keys]]', 11, ["$.keys", "it is a table", "[keys]"]),
    ('"3", "4"]', '"3", "bogus"]', 12, ["$.keys.pool[3]", "'bogus'", "a to z"]),
    ('"3", "4"]', '"3", "spacebar"]', 12, ["'spacebar'", "did you mean 'space'?"]),
    ('"3", "4"]', '"3", "3"]', 12, ["'3' again", "once"]),
    ('"3", "4"]', '"3", "escape"]', 12, ["'escape'", "choose another"]),
    ('pool = ["1", "2",\n  "3", "4"]', 'pool = [1, 2]', 12, ["$.keys.pool[0]", "is 1", 'pool = ["...", "..."]']),
    ('pool = ["1", "2",\n  "3", "4"]', 'pool = "1234"', 12, ["'1234'", "a list"]),
    ('pool = ["1", "2",\n  "3", "4"]', 'pool = ["1", "2"]', 26, ["block 'g'", "has 3 for 2 keys", "add keys"]),
    ('[keys]', '[keys]\nspare_keys = "nothing"', 12, ["'nothing'", "ignore, distractor"]),
    ('[keys]', '[keys]\nspare_keys = "distractor"', 24, ["block 'g'", "distractors", "is empty"]),
    ('[keys]', '[keys]\ncheck = "no"', 12, ["'no'", "true or false"]),
    ('[[groups]]\nname = "late"\nblocks = ["h", "g"]\n', '', 0, []),  # no mistake: one group is a study
    ('[[groups]]\nname = "early"\nblocks = ["g", "h"]\n\n[[groups]]', '[groups]', 15, ["one table", "[[groups]]"]),
    ('blocks = ["h", "g"]', 'blocks = ["h", "attic"]', 21, ["group 'late'", "'attic'", "blocks: g, h"]),
    ('blocks = ["h", "g"]', 'blocks = "h"', 21, ["group 'late'", "'h'", "a list"]),
    ('name = "late"', 'name = "early"', 20, ["'early' again", "its own name"]),
    ('name = "late"\n', '', 19, ["$.groups[1]", "needs the field `name`"]),
    ('episodes = 2', 'episods = 2', 36, ["block 'h'", "'episodes'"]),
    ('episodes = 2', 'episodes = "ten"', 36, ["block 'h'", "'ten'", "episodes = 10"]),
    ('episodes = 2', 'episodes = 0', 36, ["block 'h'", "is 0", "1 to 10000"]),
    ('max_steps = 20', 'max_steps = 0', 38, ["block 'h'", "is 0", "1 to 1000000"]),
    ('pace = "real_time"', 'pace = "realtime"', 39, ["block 'h'", "'realtime'", "did you mean 'real_time'?"]),
    ('step_period_ms = 300.0', 'step_period_ms = 1.0', 40, ["block 'h'", "1.0", "5 to 60000"]),
    ('step_period_ms = 300.0', 'auto_repeat = true\nstep_period_ms = 300.0', 40, ["block 'h'", "auto_repeat"]),
    ('step_period_ms = 300.0', 'step_period_ms = 300.0\nview = "top"', 41, ["'top'", "partial, full"]),
    ('step_period_ms = 300.0', 'step_period_ms = 300.0\npalette = 3', 41, ["block 'h'", "is 3", '"classic"']),
    ('key_map = "new"', 'key_map = "cary_over"', 30, ["block 'g'", "'cary_over'", "did you mean 'carry_over'?"]),
    ('seeds = "new"', 'view = "text"\ncomputed = "page"', 30, ["block 'g'", "view is 'text'", "use 'server'"]),
    ('seeds = "new"', 'computed = "phone"', 29, ["block 'g'", "'phone'", "page, server"]),
    ('seeds = "new"', 'seeds = [1, 2]', 29, ["block 'g'", "2 seeds for 3", "one per episode"]),
    ('seeds = "new"', 'seeds = [1, 2, -3]', 29, ["block 'g'", "not from 0 to", "0 or more"]),
    ('"{outcome}"', '"{outcom}"', 31, ["block 'g'", "placeholder", "use outcome"]),
    ('level = "episode"', 'level = "trial"', 44, ["'trial'", "episode, participant"]),
    ('above = 40.0\n', '', 42, ["compares nothing", "give below or above"]),
    # against the worlds
    ('actions = ["left", "right", "forward"]\nmax_steps = 20', 'actions = ["left", "fly"]\nmax_steps = 20', 37,
     ["block 'h'", "'fly'", "its actions are left, right, forward"]),
    ('actions = ["left", "right", "forward"]\nmax_steps = 20', 'actions = ["left", "left"]\nmax_steps = 20', 37,
     ["block 'h'", "'left' twice", "name each once"]),
    ('minihuman/MiniGrid-Empty-5x5-v0', 'MiniGrid-GoToObj-Transfer-v0', 35, ["'minihuman/MiniGrid-GoToObj-Tr"]),
    ('minihuman/MiniGrid-Empty-5x5-v0', 'minihuman/MiniGrid-Emty-5x5-v0', 35, ["did you mean 'minihuman/MiniGrid-Emp"]),
    ('minihuman/MiniGrid-Empty-5x5-v0', 'nowhere:lab/Maze-v0', 35, ["block 'h'", "nowhere", "install"]),
    ('MiniGrid-FourRooms-v0"', 'MiniGrid-GoToObj-Transfer-v0"\ncomputed = "page"', 26, ["block 'g'", "are Python"]),
    ('max_steps = 20', 'max_steps = 2000', 38, ["block 'h'", "is 2000", "ask for 100 or fewer"]),
    ('step_period_ms = 300.0', 'step_period_ms = 300.0\noptions = { colour = "red" }', 35, ["block 'h'", "colour"]),
]  # fmt: skip


def mistakes(toml: str) -> tuple[str, ...]:
    try:
        check_worlds(decode_protocol(toml.encode(), "tiny.toml"), "tiny.toml")
    except ProtocolError as error:
        return error.mistakes
    return ()


def test_without_a_mistake_nothing_is_said() -> None:
    assert mistakes(GOOD) == ()


@pytest.mark.parametrize(("old", "new", "line", "words"), MISTAKES)
def test_a_mistake_is_told_with_its_line_its_block_its_value_and_the_way_out(
    old: str, new: str, line: int, words: list[str]
) -> None:
    before, found, after = GOOD.rpartition(old)
    assert found
    told = mistakes(before + new + after)
    if not words:
        assert told == ()
        return
    where = [one for one in told if one.startswith(f"tiny.toml:{line}: ")]
    assert where, told
    assert any(all(word in one for word in words) for one in where), where
    assert not any("\n" in one for one in told)


def test_there_are_as_many_as_were_tried_once() -> None:
    assert len(MISTAKES) >= 49


def test_all_are_told_at_once_in_order_of_line_and_the_error_itself_is_one_line() -> None:
    wrong = GOOD.replace('version = "1"', "version = 1").replace("episodes = 3", "episodes = true")
    with pytest.raises(ProtocolError) as failed:
        decode_protocol(wrong.replace("[[exclusions]]", "[[exclusion]]").encode(), "tiny.toml")
    lines = [int(re.match(r"tiny\.toml:(\d+)", one)[1]) for one in failed.value.mistakes]
    assert lines == sorted(lines) == [3, 26, 42]
    assert str(failed.value).endswith("(and 2 more: minihuman check tiny.toml says all)")
    assert "\n" not in str(failed.value)


def test_a_byte_order_mark_is_no_mistake() -> None:
    assert decode_protocol(b"\xef\xbb\xbf" + GOOD.encode()).study.name == "tiny"


def test_lines_are_found_past_strings_and_lists_that_go_on() -> None:
    lines = TomlLines(GOOD)
    assert lines.of("$.keys.pool[3]") == 12
    assert lines.of("$.groups[1].blocks[0]") == 21
    assert lines.of("$.blocks[1].pace") == 39
    assert lines.of("$.blocks[1].nothing") == 33
    assert lines.of("$.key") == 1
