"""Groups by design and studies that stop: decided under the register's lock, in the log without codes, asked again."""

import shutil

import msgspec
import pytest

from minihuman.admin.design_decisions import verify_design_decisions
from minihuman.admin.enrolment_entries import LookTaken, read_enrolled, read_enrolment_log
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.contents import LogSegment
from minihuman.admin.verify.log import find_log_differences
from minihuman.admin.verify.plan import compare_slot
from minihuman.admin.verify.study import verify_enrolment
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.errors import AllocationError, ProtocolError
from minihuman.experiment.plan.enrolment_designs import GroupSequential
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.methods import build_methods
from minihuman.reporting.participant_flow import looks_table
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World

TOML = """
[study]
name = "groups"
version = "1"
seed = 8
closing = ""
[keys]
pool = ["f", "j"]
keyboard_check = false
[allocation]
{allocation}
[allocation.stopping]
name = "group-sequential"
settings = {{ looks = [4, 8], outcome = "success", block = "words" }}
{questions}
[[groups]]
name = "good"
parts = [{parts}"words"]
[[groups]]
name = "bad"
parts = [{parts}"words"]
[[blocks]]
name = "words"
kind = "trials"
world = "minihuman/Stimulus-v0"
episodes = 2
actions = ["left", "right"]
options = {{ chance_left = 1, chance_right = 1 }}
max_steps = 1
ready = "none"
final_frame_ms = 0
[blocks.group_overrides.bad]
options = {{ chance_left = 0, chance_right = 0 }}
"""
THOMPSON = TOML.format(allocation='design = { name = "thompson" }', questions="", parts="")
MINIMISED = TOML.format(
    allocation='stratify_by = "about.games"\ndesign = { name = "minimisation", settings = { probability = 1 } }',
    questions='[[questions]]\nname = "about"\n[[questions.items]]\nname = "games"\nkind = "choice"\nask = "?"\n'
    'options = ["often", "rarely"]\n',
    parts='"about", ',
)


@pytest.fixture(scope="module", params=[THOMPSON, MINIMISED], ids=["thompson", "minimisation"])
def study(request, tmp_path_factory):
    """A study that no more than eight are enrolled in, simulated until it stops; its protocol, folder and error."""
    protocol, data = decode_protocol(request.param.encode()), tmp_path_factory.mktemp("data")
    with pytest.raises(AllocationError) as stopped:
        list(simulate(protocol, data, participants=9, seed=1, player="random"))
    return protocol, data / "groups", str(stopped.value)


def test_a_study_stops_at_its_looks_and_enrols_nobody_else(study):
    protocol, folder, error = study
    looks = [line for line in read_enrolment_log(folder) if isinstance(line, LookTaken)]
    assert [(look.look, look.stop) for look in looks] == [(1, False), (2, True)]
    assert "stopped at look 2 of its sequential design" in error
    assert len(read_enrolled(folder)) == 8
    with pytest.raises(AllocationError, match="stopped at look 2"):
        plan_next_session(protocol, folder.parent)
    assert looks[1].statistics["good"][1] == 1.0
    shown = looks_table(looks)
    assert tuple(shown.heads)[:3] == ("look", "n, good", "n, bad")
    assert [row[-1] for row in shown.rows] == ["went on", "stopped"]


def test_each_assignment_is_in_the_log_without_codes_and_follows_from_its_statistics(study):
    protocol, folder, _ = study
    for line in read_enrolled(folder):
        [path] = (folder / line.participant / "ses-01").glob("*.mcap")
        who = read_log(path).plan.participant
        assert who.assigned == line.assigned
        assert who.assigned.design == protocol.allocation.design.name
        assert b"sub-" not in msgspec.json.encode(who.assigned)
        assert list(find_log_differences(path, World)) == []
    if protocol.allocation.stratify_by:
        groups = [(line.stratum, line.group) for line in read_enrolled(folder)]
        for stratum in {stratum for stratum, _ in groups}:
            assert abs(groups.count((stratum, "good")) - groups.count((stratum, "bad"))) <= 1
    else:
        last = read_enrolled(folder)[-1].assigned.statistics
        assert last["good"][1] == last["bad"][0] == 0.0
        assert last["good"][0] + last["bad"][1] == 7.0


def test_the_report_says_what_was_adaptive(study):
    protocol, folder, _ = study
    with StudyStore(StudySessions(folder, processes=1), with_shortest=False) as store:
        outlines = [kept.outline for kept in store.cached_sessions]
        said = build_methods(outlines, [kept.quality for kept in store.cached_sessions], 8, protocols=[protocol])
    name = protocol.allocation.design.name
    assert f"Groups were assigned by the adaptive design {name}" in said[1]
    assert "Enrolment could be stopped by the adaptive design group-sequential (looks = [4, 8]" in said[1]
    assert "Keys came from an allocation list" in said[0]
    assert ("the design knew the stratum" in said[0]) == (name == "minimisation")


def test_verify_repeats_the_statistics_and_names_what_does_not_follow(study, monkeypatch):
    protocol, folder, _ = study
    fine = "10 of 10 decisions of the study's designs follow from its logs", True
    assert fine in list(verify_enrolment(folder))
    lines = list(read_enrolment_log(folder))
    at = next(at for at, line in enumerate(lines) if isinstance(line, LookTaken))
    wrong = {**lines[at].statistics, "good": [2, 0.5, 0.1]}
    for change, said in (({"statistics": wrong}, "look 1: statistics"), ({"stop": True}, "look 1: {'look'")):
        changed = [*lines[:at], msgspec.structs.replace(lines[at], **change), *lines[at + 1 :]]
        monkeypatch.setattr(
            "minihuman.admin.design_decisions.read_enrolment_log", lambda _, found=changed: tuple(found)
        )
        found = list(verify_design_decisions(folder, protocol))
        assert [good for _, good in found] == [False, True]
        assert found[0][0].startswith(said)


def test_a_group_that_does_not_follow_from_its_statistics_is_named(study):
    protocol, folder, _ = study
    [path] = (folder / "sub-08" / "ses-01").glob("*.mcap")
    plan = read_log(path).plan
    other = {"good": "bad", "bad": "good"}[plan.participant.group]
    swapped = msgspec.structs.replace(plan.participant, group=other)
    segment = LogSegment({})
    [found] = compare_slot(protocol, segment, msgspec.structs.replace(plan, participant=swapped))
    assert found == (
        f"plan: participant's group {other!r}, by the statistics of {protocol.allocation.design.name} "
        f"{plan.participant.group!r}"
    )
    unassigned = msgspec.structs.replace(plan.participant, assigned=None)
    [found] = compare_slot(protocol, segment, msgspec.structs.replace(plan, participant=unassigned))
    assert found == "plan: the group's assignment is not by the protocol's design"


def test_who_withdrew_is_counted_as_gone(study, tmp_path):
    protocol, folder, _ = study
    copy = tmp_path / "groups"
    shutil.copytree(folder, copy)
    withdraw_participant(copy, "sub-02", seal=None)
    [(line, good)] = verify_design_decisions(copy, protocol)
    assert good
    assert "decisions of the study's designs follow from its logs; " in line
    assert line.endswith("use logs that are gone")


def test_what_cannot_be_decided_is_refused():
    for wrong, said in (
        (THOMPSON.replace('"words" }', '"word" }'), "there is no block 'word'"),
        (THOMPSON.replace("[4, 8]", "[8, 4]"), "looks is [8, 4]; use rising numbers"),
        (THOMPSON.replace('"thompson"', '"staircase"'), "'staircase'"),
    ):
        with pytest.raises(ProtocolError) as refused:
            decode_protocol(wrong.encode())
        assert said in str(refused.value)
    assert GroupSequential({"looks": [4]}).outcome == "success"
