"""The forms of a protocol's tables: every field with its sentence, type, unit and choices, and what can be added."""

import io
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from minihuman.builder.card_pictures import BLANK_PNG, draw_template
from minihuman.builder.document import TomlDocument
from minihuman.builder.form import build_form, list_kinds
from minihuman.builder.messages import FormField, NewStudyRequest
from minihuman.builder.new_study import list_templates, make_study
from minihuman.experiment.protocol.protocol import decode_protocol, list_protocol_tables
from minihuman.trust import Trust

CONSENTED = """
[study]
name = "rooms"
version = "1"
seed = 4
[[groups]]
name = "all"
parts = ["consent", "walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
"""


def find_field(table: str, name: str, kind: str = "") -> FormField:
    return next(field for field in build_form(table, kind).fields if field.name == name)


@pytest.mark.parametrize("table", list_protocol_tables())
def test_every_field_of_every_table_is_in_its_form_with_a_sentence_and_an_example(table: str) -> None:
    heading, fields = list_protocol_tables()[table]
    form = build_form(table)
    assert form.heading == heading
    assert [field.name for field in form.fields] == [field.name for field in fields]
    assert all(field.sentence and field.example is not None for field in form.fields)
    assert all(field.common for field in form.fields if field.required)
    assert not any(field.type == "any" for field in form.fields)


def test_types_units_choices_and_references_are_those_of_the_schema() -> None:
    period = find_field("blocks", "step_period_ms")
    assert (period.type, period.unit, period.default) == ("number", "ms", 0.0)
    interval = find_field("blocks", "inter_trial_interval_ms")
    assert (interval.type, interval.alternatives, interval.unit) == ("number", ["pair"], "ms")
    days = find_field("sessions", "days_after_previous")
    assert (days.type, days.item, days.unit) == ("pair", "integer", "days")
    key_map = find_field("blocks", "key_map")
    assert (key_map.type, key_map.default) == ("choice", "new")
    assert {choice.value for choice in key_map.choices} == {"new", "carry_over", "constant", "shown", "fixed"}
    assert find_field("blocks", "instructions").type == "text"
    assert find_field("blocks", "world").references == "world"
    assert find_field("groups", "parts").references == "part"
    assert find_field("blocks", "stimuli").table == "blocks.stimuli"
    assert find_field("questions", "items").type == "tables"
    assert "likert" in {choice.value for choice in find_field("questions.items", "kind").choices}
    assert "team" in {choice.value for choice in find_field("blocks", "kind").choices}


def test_a_form_has_the_tables_of_its_kind_and_what_studies_use_first() -> None:
    names = {field.name for field in build_form("blocks", "play").fields}
    assert {"agent", "team", "timeline"}.isdisjoint(names)
    trials = {field.name: field.common for field in build_form("blocks", "trials").fields}
    assert trials["timeline"]
    assert trials["response_deadline_ms"]
    assert not trials["record_observations"]


def test_there_is_no_form_of_an_unknown_table() -> None:
    with pytest.raises(KeyError):
        build_form("blocks.nothing")


def test_kinds_of_parts_and_questions_are_those_that_are_installed() -> None:
    kinds = list_kinds()
    tables = {part.kind: part.table for part in kinds.parts}
    assert tables["page"] == "pages"
    assert tables["trials"] == tables["play"] == tables["team"] == "blocks"
    assert tables["correction"] == "activities"
    assert not {"keyboard_check", "debrief"} & tables.keys()
    assert {"choice", "likert", "slider", "text"} <= {kind.kind for kind in kinds.questions}
    assert "minihuman/MiniGrid-FourRooms-v0" in {world.value for world in kinds.worlds}


def test_a_consent_page_to_begin_with_is_valid_in_each_language_and_leaves_the_same_places_open() -> None:
    kinds = list_kinds()
    (consent,) = (kind for kind in kinds.parts if kind.kind == "consent")
    assert consent.new == kinds.consents["en"]
    assert kinds.consents.keys() == set(kinds.languages)
    texts = []
    for fields in kinds.consents.values():
        document = TomlDocument.parse(CONSENTED).insert(("pages", 0), {**fields, "name": "consent"})
        (page,) = decode_protocol(document.text.encode()).pages
        assert page.asks_consent
        texts.append(page.text)
    assert {text.count("\n\n") for text in texts} == {3}  # purpose, storage, rights, contact
    assert {text.count("[") for text in texts} == {texts[0].count("]")} == {7}


def test_templates_are_at_least_sixteen_studies_with_their_minutes() -> None:
    templates = {template.name: template for template in list_templates()}
    assert len(templates) == len(list_templates()) >= 16
    assert {template.group for template in templates.values()} == {"start", "example", "trials"}
    stroop = templates["trials/stroop"]
    assert stroop.files == ["stroop.csv"]
    assert stroop.minutes is not None
    assert 1 < stroop.minutes[0] < stroop.minutes[1] < 10
    assert "Stroop, 1935" in stroop.summary


def test_a_notebook_beside_a_study_runs_from_its_first_cell_to_its_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert make_study(NewStudyRequest("My rooms", template="notebook"), tmp_path, None).name == "my-rooms.toml"
    notebook = json.loads((tmp_path / "my-rooms.ipynb").read_text())
    assert (notebook["nbformat"], notebook["cells"][0]["cell_type"]) == (4, "markdown")
    monkeypatch.chdir(tmp_path)
    variables: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(cell["source"], variables)
    assert len(variables["frames"]) == len(variables["session"].episodes[0].actions) + 1


def test_a_template_with_python_of_its_own_is_copied_with_it_and_left_to_the_user_to_trust(tmp_path: Path) -> None:
    name = "navigation/radial-arm-maze"
    template = next(template for template in list_templates() if template.name == name)
    assert template.files == ["radial_arm_maze.py"]
    assert template.minutes is not None
    path = make_study(NewStudyRequest(name="maze", template=name), tmp_path, None)
    assert path == tmp_path / "maze" / "maze.toml"
    assert (path.parent / "radial_arm_maze.py").is_file()
    assert tomllib.loads(path.read_text())["study"]["name"] == "maze"
    assert not Trust.read().holds(path)


@pytest.mark.parametrize("name", ["trials/flanker", "trials/go-no-go", "examples/demo"])
def test_the_picture_of_a_template_shows_a_world_or_a_stimulus(name: str) -> None:
    with Image.open(io.BytesIO(draw_template(name))) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    n_drawn = (pixels != pixels[0, 0]).any(axis=-1).sum()
    assert n_drawn > 200  # a fixation cross has fewer


@pytest.mark.nightly
def test_a_template_with_python_of_its_own_is_drawn_without_trust() -> None:
    assert draw_template("navigation/radial-arm-maze") != BLANK_PNG
