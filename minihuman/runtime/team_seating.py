"""The teams of a protocol, and the ways of running a study in which the people of a team can meet."""

from collections.abc import Iterator

from minihuman.activities.team.plan import TeamPlan
from minihuman.errors import AllocationError
from minihuman.experiment.protocol.protocol import Protocol


def count_seats_at_machine(protocol: Protocol, group: str | None = None) -> int:
    """Return how many people share one machine: the largest number in a team whose seats have different keys.

    It is 1 if no block has a team with such keys. Without a ``group``, the teams of all groups count.
    """
    teams = [team for _, team in list_teams(protocol, group)]
    return max((len(team.persons) for team in teams if team.seat_keys), default=1)


def list_teams(protocol: Protocol, group: str | None) -> Iterator[tuple[str, TeamPlan]]:
    """Yield the name and the team of each block with a team, in one group; in all groups if ``group`` is None."""
    groups = [spec.name for spec in protocol.groups] if group is None else [group]
    for block in protocol.blocks:
        for name in groups:
            team = protocol.block_for(block.name, name).team
            if team is not None:
                yield block.name, team


def require_one_process(protocol: Protocol, way: str, *, group: str | None = None, at_one_machine: int = 1) -> None:
    """Refuse to run a study in a way in which the people of a team could not meet.

    Args:
        protocol: the study.
        way: how it is run and what to do instead, for the message.
        group: the participant's group; None for any.
        at_one_machine: the number of people at this machine.

    Raises:
        AllocationError: if several people sit in one world in a block of the group.
    """
    for block, team in list_teams(protocol, group):
        if (seats := len(team.persons)) not in (1, at_one_machine):
            raise AllocationError(f"block {block!r} is for {seats} people, who cannot play together {way}")
