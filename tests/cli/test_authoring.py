"""From nothing to a study that runs: new, check, run; and the schema that editors go by."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from minihuman.admin.legibility import require_legible
from minihuman.admin.protocol_file import ProtocolDraft
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import describe_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import build_json_schema, decode_protocol
from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS
from tests.counts import PATIENCE_S
from tests.programs import running
from tests.seats.session_typist import agree, enter_at, until
from tests.xserver import Typist

pytestmark = pytest.mark.program
PROTOCOLS = Path(__file__).parents[2] / "protocols"


def minihuman(*words: object, **more: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, **more)


def test_two_commands_lead_from_nothing_to_the_first_picture(tmp_path: Path, display: str) -> None:
    assert minihuman("new", tmp_path, "--yes", "--name", "My First Study").returncode == 0
    protocol = tmp_path / "my-first-study.toml"
    said = minihuman("check", protocol)
    assert said.returncode == 0, said.stderr
    assert "MiniGrid-FourRooms-v0" in said.stdout
    command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", str(tmp_path), "--windowed"]
    with running(command, env={"DISPLAY": display}, stdout=subprocess.PIPE, text=True) as station:
        typist = Typist(display)
        typist.focus("minihuman")
        agree(typist, tmp_path)
        until(tmp_path, "keyboard_check")
        typist.tap(*"123456789")
        enter_at(typist, tmp_path, "instructions", "page")
        enter_at(typist, tmp_path, "ready")
        until(tmp_path, "playing")
        typist.ask_to_close("minihuman")
        told, _ = station.communicate(timeout=PATIENCE_S)
        typist.close()
    assert "ended by window_closed after 0 of 5 episodes" in told
    assert "goes on with: minihuman run" in told
    assert "--participant sub-01" in told


def test_nothing_is_written_over(tmp_path: Path) -> None:
    assert minihuman("new", tmp_path, "--yes").returncode == 0
    again = minihuman("new", tmp_path, "--yes")
    assert (again.returncode, again.stderr.count("\n")) == (2, 1)
    assert "already exists; choose another name with --name" in again.stderr


def test_questions_are_asked_and_their_answers_taken(tmp_path: Path) -> None:
    answers = "Maze of Lab 3\nminihuman/MiniWorld-Maze-v0\n2\n12\ny\n"
    assert minihuman("new", tmp_path, input=answers).returncode == 0
    tree = tomllib.loads((tmp_path / "maze-of-lab-3.toml").read_text())
    assert tree["study"]["participants"] == 12
    (block,) = tree["blocks"]
    assert (block["world"], block["episodes"], block["key_map"]) == ("minihuman/MiniWorld-Maze-v0", 2, "shown")


def test_the_schema_takes_the_shipped_protocols_and_no_misspelt_field() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads(minihuman("schema").stdout)
    assert schema == json.loads(json.dumps(build_json_schema()))
    for path in sorted(PROTOCOLS.glob("*.toml")):
        jsonschema.validate(tomllib.loads(path.read_text()), schema)
    tree = tomllib.loads((PROTOCOLS / "demo.toml").read_text())
    tree["blocks"][0]["episods"] = 3
    with pytest.raises(jsonschema.ValidationError, match="episods"):
        jsonschema.validate(tree, schema)


def test_it_says_its_version_and_helps_at_h() -> None:
    assert minihuman("--version").stdout.startswith("minihuman 0.")
    assert "watch" in minihuman("-h").stdout


def test_every_world_is_listed_as_json():
    told = json.loads(minihuman("worlds", "--json").stdout)
    assert [one["id"] for one in told] == [entry.id for entry in (*WORLDS, *TEAM_WORLDS)]
    assert all(one["summary"] for one in told)


@pytest.mark.parametrize("language", ["en", "he", "nl"])
@pytest.mark.parametrize(
    ("templates", "sessions", "groups", "kind"),
    [
        (("two-days", "three-groups"), 2, 3, "play"),
        (("trials", "two-days", "browser"), 2, 1, "trials"),
        (("team",), 0, 1, "team"),
        (("browser",), 0, 1, "play"),
        (("two-groups",), 0, 2, "play"),
        (("two-groups", "browser"), 0, 2, "play"),
    ],
)
def test_a_template_is_a_study_that_can_be_shown(templates, sessions, groups, kind, language):
    toml = ProtocolDraft(templates=templates, language=language).toml()
    study = decode_protocol(toml.encode())
    assert (len(study.sessions), len(study.groups)) == (sessions, groups)
    assert {block.kind for block in study.blocks} == {kind}
    assert study.web.open_access == bool({"browser", "team"} & {*templates})
    assert study.study.language == language
    if language == "he" and kind != "team":
        require_legible(study, "the template")


def test_the_blocks_of_a_template_keep_their_questionnaires():
    study = decode_protocol(ProtocolDraft(templates=("two-days", "three-groups")).toml().encode())
    plan = expand_protocol(study, enrol_participant(study, 0, "found"))
    names = [part.name for part in plan.parts]
    at = names.index("task-a"), names.index("task-b")
    assert [names[place + 1] for place in at] == ["opinion", "opinion"]
    assert [item.kind for item in plan.parts[at[0] + 1].plan.items] == ["likert"]


def test_an_unknown_template_is_named_with_those_that_there_are(tmp_path: Path) -> None:
    refused = minihuman("new", tmp_path, "--yes", "--template", "two-days,tree-groups")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "template 'tree-groups' is unknown; templates: two-groups, two-days, three-groups" in refused.stderr


def test_two_groups_play_the_worlds_in_opposite_orders_and_answer_last():
    worlds = "minihuman/MiniGrid-DoorKey-6x6-v0, minihuman/MiniWorld-Hallway-v0"
    study = decode_protocol(ProtocolDraft(world=worlds, templates=("two-groups",)).toml().encode())
    played = {}
    for group in study.groups:
        plan = expand_protocol(study, enrol_participant(study, 0, group.name))
        played[group.name] = [part.name for part in plan.parts]
    assert played["forward"][-4:] == ["world-1", "world-2", "opinion", "closing"]
    assert played["backward"][-4:] == ["world-2", "world-1", "opinion", "closing"]
    assert {name: parts[0] for name, parts in played.items()} == {"forward": "consent", "backward": "consent"}
    assert [block.world.split("/")[1] for block in study.blocks] == ["MiniGrid-DoorKey-6x6-v0", "MiniWorld-Hallway-v0"]


def test_a_new_study_has_keys_for_every_action_that_its_world_needs():
    study = decode_protocol(ProtocolDraft(world="minihuman/MiniGrid-DoorKey-6x6-v0").toml().encode())
    assert study.blocks[0].actions == ("left", "right", "forward", "pickup", "toggle")
    assert [line for line in describe_worlds(study) if "shortest path" in line] == []


def test_several_worlds_are_blocks_or_stages():
    worlds = "minihuman/MiniGrid-Empty-5x5-v0,minihuman/MiniGrid-FourRooms-v0"
    several = decode_protocol(ProtocolDraft(world=worlds).toml().encode())
    assert several.groups[0].blocks == ("world-1", "world-2")
    staged = decode_protocol(ProtocolDraft(world=worlds, templates=("three-groups",)).toml().encode())
    assert [block.world for block in staged.blocks] == [worlds.split(",")[place] for place in (0, 0, 1)]


@pytest.mark.parametrize("others", ["two-days", "three-groups", "trials", "team"])
def test_templates_of_two_kinds_are_refused_by_name(others: str) -> None:
    with pytest.raises(ProtocolError, match=f"'two-groups' and '{others}' are two kinds of study; choose one"):
        ProtocolDraft(templates=("two-groups", others)).toml()
