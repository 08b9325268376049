"""What in a block of trials needs a server."""

from collections.abc import Iterator

from minihuman.activities.play.server_needs import list_block_needs
from minihuman.activities.trials.plan import TrialsPlan
from minihuman.experiment.plan.session_plan import PlannedPart


def find_server_needs(part: PlannedPart) -> Iterator[str]:
    """Yield a clause such as "gives points" for each property of a block of trials that needs a server."""
    plan: TrialsPlan = part.plan
    yield from list_block_needs(plan)
    if not plan.timeline:
        yield "is a block of trials without a timeline"
        return
    for stimulus in plan.timeline.stimuli:
        if stimulus.feedback:
            yield f"plays the sound {stimulus.name!r} with the feedback"
