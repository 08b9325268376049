"""The results of `minihuman check` for a protocol file, as values: mistakes at their fields, notices, and a plan."""

import hashlib
import warnings
from pathlib import Path

from minihuman.admin.legibility import require_legible
from minihuman.admin.protocol_file import read_protocol
from minihuman.builder.description import list_mistakes
from minihuman.builder.messages import CheckReport
from minihuman.dataset.selection import check_exclusion_measures
from minihuman.errors import MinihumanError
from minihuman.experiment.plan.dry_run import (
    check_worlds,
    describe_plan,
    describe_strata,
    describe_worlds,
    list_missing_words,
)
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.outcome_check import check_outcome_rules
from minihuman.experiment.plan.protocol_notices import list_protocol_notices


def check_study(path: Path) -> CheckReport:
    """Check a protocol with its worlds and texts as `minihuman check` does; worlds that are not trusted do not run.

    The report has either mistakes, or notices and the plan of all sessions of the first participant.

    Raises:
        OSError: if the file cannot be read.
    """
    content = path.read_bytes()
    version = hashlib.sha256(content).hexdigest()
    source = str(path)
    with warnings.catch_warnings(record=True) as caught_warnings:
        warnings.simplefilter("always", FutureWarning)
        try:
            protocol = read_protocol(path)
            check_exclusion_measures(protocol.exclusions, source)
            world_notices = check_worlds(protocol, source, provable=True)
            outcome_notices = check_outcome_rules(protocol, source)
            sessions = range(1, max(1, len(protocol.sessions)) + 1)
            participant = enrol_participant(protocol, 0, None)
            plans = [expand_protocol(protocol, participant, session=number) for number in sessions]
            require_legible(protocol, source)
        except MinihumanError as error:
            return CheckReport(version, list_mistakes(error, source, content), [], [])
    old_names = [str(warning.message) for warning in caught_warnings if issubclass(warning.category, FutureWarning)]
    notices = [
        *old_names,
        *list_missing_words(protocol),
        *list_protocol_notices(protocol),
        *outcome_notices,
        *describe_worlds(protocol, world_notices),
    ]
    plan = [line for session_plan in plans for line in describe_plan(session_plan)]
    return CheckReport(version, [], notices, [*plan, *describe_strata(protocol)])
