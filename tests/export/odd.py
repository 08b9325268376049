"""A study with every field of `[about]`, codes, versions and answers that readers misread, and texts that run."""

import dataclasses
import json
from pathlib import Path

import numpy as np

from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.events import Answered
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.golden.make import STARTED_NS

CODES = ("sub-01", "sub-02")
FORMULA = '=HYPERLINK("http://example.org";"a")\n-2+3;@x'
LONG = "ä" * 3000
TOML = """
[study]
name = "007"
version = "1.10"
seed = 9223372036854775807
[keys]
keyboard_check = false
[[groups]]
name = "01"
parts = ["true", "odd"]
[[groups]]
name = "na"
parts = ["true", "odd"]
[[blocks]]
name = "true"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 6
[[questions]]
name = "odd"
items = [
    { name = "choice", kind = "choice", ask = "?", options = ["NA", "null", "TRUE"], codes = ["NA", "001", "1.10"] },
    { name = "words", kind = "text", ask = "Why?", required = false },
]
[analysis]
primary_measure = "log_excess_steps_mean"
[about]
title = "A study: of \\"007\\" & others"
description = "People find keys, = and doors."
licence = "CC-BY-4.0"
funding = ["Grant 7"]
ethics_approvals = ["Board of the faculty, 2026-17"]
institution = "University of Nowhere"
department = "Department of Doors"
address = "1 Street, Town"
keywords = ["navigation", "transfer"]
doi = "10.1234/abcd"
references = ["Doe, J. (2024). A work. https://doi.org/10.1000/182", "A book."]
how_to_acknowledge = "Please cite: the study."
task_description = "Find the goal."
[[about.authors]]
name = "Ada Lovelace"
orcid = "0000-0002-1825-0097"
email = "ada@example.org"
affiliation = "University of Nowhere"
[[about.authors]]
name = "Plato"
[[about.participant_columns]]
name = "age"
type = "integer"
unit = "year"
description = "Age at the session."
[[about.participant_columns]]
name = "hand"
description = "The hand at the keys."
levels = { left = "left-handed", right = "right-handed" }
[[about.participant_columns]]
name = "code"
description = "A laboratory's own code."
[[about.participant_columns]]
name = "with"
type = "boolean"
description = "A word that SPSS and Stata reserve."
[[about.participant_columns]]
name = "a_column_with_a_name_that_is_too_long_for_stata"
type = "number"
description = "A number."
"""
PEOPLE = """participant,age,hand,code,with,a_column_with_a_name_that_is_too_long_for_stata
sub-01,31,left,=1+1,TRUE,0.1
sub-02,,right,0012,,
"""


class Writing(McapRecorder):
    """Records other answers than the simulated participant gave: those that readers misread or run."""

    answers = ({"choice": ("NA", "NA"), "words": (FORMULA, "")}, {"choice": ("1.10", "TRUE"), "words": (LONG, "")})
    participant = 0

    def begin(self, events):
        super().begin([self._answer(event) for event in events])

    def _answer(self, event):
        if not isinstance(event, Answered):
            return event
        value, words = self.answers[self.participant][event.item]
        return dataclasses.replace(event, value=json.dumps(value), words=words)


def record_odd_study(folder: Path) -> Path:
    """Record two sessions of the study and lay the laboratory's table beside them; return the study's folder."""
    protocol = decode_protocol(TOML.encode())
    for number, code in enumerate(CODES):
        plan = plan_next_session(protocol, folder, participant=code, session=1)
        clock = VirtualClock()
        session = SessionMachine(plan, World, {"player": "random", "utc_offset_min": "-210"}, picture_px=None)
        recorder = Writing(folder, plan, started_ns=STARTED_NS + 123_456_789)
        recorder.participant = number
        player = make_participant("random", np.random.default_rng(5))
        run_session(session, SimulatedWindow(player, session, clock), recorder, clock)
    (folder / "007" / "participants.csv").write_text(PEOPLE, encoding="utf-8")
    return folder / "007"
