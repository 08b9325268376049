"""Every sentence of the methods text is true of each participant whom it is about: compared with their plan."""

import re
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.recording_quality import PlanOutline
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.reporting.methods import build_methods

PROTOCOLS = Path(__file__).parents[2] / "protocols"
BLOCK = """
[[blocks]]
name = "{name}"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 3
actions = ["left", "right", "forward"]
max_steps = 30
{more}
"""
HEAD = """
[study]
name = "truth"
version = "1"
seed = 4
participants = 24
[keys]
check = false
pool = ["1", "2", "3", "4", "5", "6", "7"]
"""
THREE_GROUPS = (
    HEAD
    + "".join(f'[[groups]]\nname = "{group}"\nblocks = ["practice", "main"]\n' for group in ("find", "see", "fast"))
    + BLOCK.format(name="practice", more="until = { successes = 2, of = 3 }")
    + BLOCK.format(
        name="main",
        more='[blocks.for_group.see]\nkey_map = "shown"\n'
        '[blocks.for_group.fast]\npace = "real_time"\nstep_period_ms = 250\nmax_steps = 12\nepisodes = 2',
    )
)
TWO_SESSIONS = (
    HEAD
    + '[[groups]]\nname = "a"\n[[groups]]\nname = "b"\n'
    + '[[sessions]]\nname = "one"\nparts = ["walk"]\n[[sessions]]\nname = "two"\nparts = ["walk"]\n'
    + '[[orders]]\nname = "walk"\nparts = ["first", "second"]\norder = "latin-square"\n'
    + BLOCK.format(name="first", more='key_map = "kept"')
    + BLOCK.format(name="second", more='key_map = "kept"\n[blocks.for_group.b]\nshow_keys = true')
)
FIXED = HEAD + '[[groups]]\nname = "all"\nblocks = ["one"]\n' + BLOCK.format(
    name="one", more='key_map = "fixed"\nfixed = { "1" = "left", "2" = "right", "3" = "forward" }'
)  # fmt: skip
STUDIES = {"three groups": THREE_GROUPS, "two sessions": TWO_SESSIONS, "fixed keys": FIXED}
SENTENCE = re.compile(
    r"Block (?P<name>\w[\w-]*)(?:, (?P<who>[^:]+))?: (?P<episodes>\d+) episodes in (?P<world>[^,]+)(?P<options>[^;]*), "
    r"(?P<view>\w+) view, at most (?P<steps>\d+) steps each; (?P<pace>[^;]+); actions (?P<actions>[\w, ]+) on "
    r"(?P<keys>\d+) keys of (?P<pool>\d+); (?P<legend>[^(.]+?)"
    r"(?: \(except by (?P<known>[^:]+), who kept the keys of the previous block\))?\."
)


def expand(study: Protocol, many: int = 12) -> list[SessionPlan]:
    sessions = range(1, max(len(study.sessions), 1) + 1)
    return [
        expand_protocol(study, enrol_participant(study, index), session=session)
        for index in range(many)
        for session in sessions
    ]


def studies() -> list[Protocol]:
    shipped = [read_protocol(PROTOCOLS / f"{name}.toml") for name in ("two-days", "fourrooms-transfer", "demo")]
    return [decode_protocol(toml.encode()) for toml in STUDIES.values()] + shipped


def is_of(plan: SessionPlan, who: str | None) -> bool:
    """Whether a sentence about these is about a participant's session."""
    if who is None:
        return True
    for label in who.split(" and "):
        group, session = re.search(r"group (\S+)", label), re.search(r"in session (\d+)", label)
        if (group is None or group[1] == plan.participant.group) and (
            session is None or int(session[1]) == plan.session
        ):
            return True
    return False


def is_known(plan: SessionPlan, known: str | None, before: str) -> bool:
    for label in (known or "").split(", "):
        name, session, after = re.fullmatch(r"(\S*)(?: in session (\d+))?(?: after block (\S+))?", label).groups()
        if (
            name == plan.participant.group
            and (session is None or int(session) == plan.session)
            and (after is None or after == before)
        ):
            return True
    return False


def does(one: EpisodePlan) -> dict[str, int]:
    return {key: one.actions.index(action) for key, action in one.key_map.keys.items() if action in one.actions}


@pytest.mark.parametrize("study", studies(), ids=[*STUDIES, "two-days", "fourrooms-transfer", "demo"])
def test_each_sentence_is_true_of_each_participant_it_is_about(study: Protocol) -> None:
    plans = expand(study)
    outlines = [PlanOutline.of(plan) for plan in plans]
    text = " ".join(build_methods(outlines, []))
    sentences = [match.groupdict() for match in SENTENCE.finditer(text)]
    assert len(sentences) == len(re.findall(r"(?<!\w)Block \w", text)), "each sentence is understood here"
    last: dict[str, EpisodePlan] = {}
    for plan, outline in zip(plans, outlines, strict=True):
        for one in outline.blocks:
            told = [its for its in sentences if its["name"] == one.block_name and is_of(plan, its["who"])]
            assert len(told) == 1, f"{plan.participant.id}, block {one.block_name}: {told}"
            its = told[0]
            assert (int(its["episodes"]), its["world"], its["view"]) == (one.episodes_in_block, one.world, one.view)
            assert int(its["steps"]) == one.max_steps
            assert its["pace"] == (
                f"one step every {one.step_period_ms:g} ms, reaction times from the onsets that the world names"
                if one.pace == "real_time"
                else "each press of a key made one step"
            )
            assert its["actions"].split(", ") == list(one.actions)
            assert int(its["keys"]) == len(one.key_map.keys)
            assert int(its["pool"]) == len(one.key_map.keys) + len(one.key_map.spare_keys)
            assert ("on the screen" in its["legend"]) == one.show_keys
            before = last.get(plan.participant.id)
            if is_known(plan, its["known"], before.block_name if before else ""):
                assert before is not None
                assert does(one) == does(before)
            elif not one.show_keys and study.blocks and before is not None and spec(study, one).key_map in CARRIED:
                raise AssertionError(f"{plan.participant.id} came to {one.block_name} with keys, which is not said")
            last[plan.participant.id] = one


CARRIED = ("carry_over", "constant")


def spec(study: Protocol, one: EpisodePlan):
    return next(block for block in study.blocks if block.name == one.block_name)


@pytest.mark.parametrize("study", studies(), ids=[*STUDIES, "two-days", "fourrooms-transfer", "demo"])
def test_the_people_and_the_sessions_are_counted_as_they_are(study: Protocol) -> None:
    plans = expand(study)
    people = build_methods([PlanOutline.of(plan) for plan in plans], [])[0]
    groups = {plan.participant.id: plan.participant.group for plan in plans}
    assert people.startswith(f"{len(groups)} participants took part")
    for group in set(groups.values()):
        assert f"{list(groups.values()).count(group)} in group {group}" in people
    keys = {tuple(sorted(one.key_map.keys)) for plan in plans for one in plan.episodes}
    assert people.count("Groups and keys came from an allocation list") == (len(keys) > 1)


def test_who_missed_the_second_session_is_not_said_to_have_come() -> None:
    plans = expand(decode_protocol(TWO_SESSIONS.encode()), 4)[:-1]
    people = build_methods([PlanOutline.of(plan) for plan in plans], [])[0]
    assert people.startswith("4 participants took part in 2 sessions (4 in session 1, 3 in session 2)")


def test_what_one_group_saw_is_not_said_of_the_others() -> None:
    text = build_methods([PlanOutline.of(plan) for plan in expand(decode_protocol(THREE_GROUPS.encode()))], [])
    [main] = [paragraph for paragraph in text if paragraph.startswith("Block main")]
    assert "Block main, group see: 3 episodes" in main
    assert main.count("were shown on the screen") == 1
    assert "Block main, group fast: 2 episodes" in main
    assert main.count("every 250 ms") == 1
