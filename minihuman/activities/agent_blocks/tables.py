"""Tables of agent blocks: the policies, their advice, and who was in control."""

import json

from minihuman.activities.agent_blocks import rows
from minihuman.activities.agent_blocks.columns import ADVICE, CONTROLS, POLICIES
from minihuman.activities.agent_blocks.events import Advised, ControlChanged, LearnerAsked, PolicyGiven
from minihuman.dataset.activity_tables import ActivityTable, TableRow
from minihuman.log.model.session_log import SessionLog


def _build_request_row(event: LearnerAsked, log: SessionLog) -> TableRow:
    return {"part": event.part + 1, "episode": event.episode + 1, "what": "asked", "policy": "", "failure": ""}


def _build_policy_row(event: PolicyGiven, log: SessionLog) -> TableRow:
    return {
        "part": event.part + 1,
        "episode": event.episode + 1,
        "what": "failed" if event.failure else "given",
        "policy": event.policy,
        "failure": event.failure,
    }


def _build_advice_row(event: Advised, log: SessionLog) -> TableRow:
    return {
        "episode": event.episode + 1,
        "step": event.step,
        "policy_action": event.action,
        "probabilities": json.dumps([round(probability, 9) for probability in event.probabilities]),
    }


def _build_control_row(event: ControlChanged, log: SessionLog) -> TableRow:
    return {
        "episode": event.episode + 1,
        "step": event.step,
        "who": event.who,
        "reason": event.reason,
        "pressed_ns": event.pressed_ns,
    }


AGENT_TABLES = (
    ActivityTable(
        "policies",
        POLICIES,
        {LearnerAsked: _build_request_row, PolicyGiven: _build_policy_row},
        topics=(rows.POLICY_TOPIC, rows.LEARNER_REQUEST_TOPIC),
    ),
    ActivityTable("advice", ADVICE, {Advised: _build_advice_row}, topics=(rows.ADVICE_TOPIC,)),
    ActivityTable("controls", CONTROLS, {ControlChanged: _build_control_row}, topics=(rows.CONTROL_TOPIC,)),
)
