"""Contract tests for plug-ins: what each kind of plug-in, from worlds to questions, guarantees.

    from minihuman.testing import check_world

    def test_my_world():
        check_world("my_lab.envs:lab/Maze-v0")

Each check raises `ContractError`, which names the broken guarantee. All built-in plug-ins pass.
"""

from minihuman.testing.checks import ContractError
from minihuman.testing.device_contract import TypedWindow, check_device, check_window
from minihuman.testing.exporter_contract import check_exporter
from minihuman.testing.learner_contract import check_learner
from minihuman.testing.part_contract import check_activity, check_design, check_question
from minihuman.testing.participant_contract import check_agent, check_participant
from minihuman.testing.world_contract import check_world

__all__ = [
    "ContractError",
    "TypedWindow",
    "check_activity",
    "check_agent",
    "check_design",
    "check_device",
    "check_exporter",
    "check_learner",
    "check_participant",
    "check_question",
    "check_window",
    "check_world",
]
