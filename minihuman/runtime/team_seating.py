"""Who has to sit together: the teams of a protocol, and which ways to run a study its people can meet in."""

from collections.abc import Iterator

from minihuman.activities.team.plan import TeamPlan
from minihuman.errors import AllocationError
from minihuman.experiment.protocol.protocol import Protocol


def count_seats_at_machine(protocol: Protocol, group: str | None = None) -> int:
    """How many people sit at one machine: as many as its blocks of teams seat, where these say each seat's keys."""
    teams = [team for _, team in list_teams(protocol, group)]
    return max((len(team.persons) for team in teams if team.seat_keys), default=1)


def list_teams(protocol: Protocol, group: str | None) -> Iterator[tuple[str, TeamPlan]]:
    """The blocks' names and teams, in a group or in all."""
    groups = [spec.name for spec in protocol.groups] if group is None else [group]
    for block in protocol.blocks:
        for name in groups:
            team = protocol.block_for(block.name, name).team
            if team is not None:
                yield block.name, team


def require_one_process(protocol: Protocol, way: str, *, group: str | None = None, at_one_machine: int = 1) -> None:
    """Refuse a way to run a study in which its people would never meet.

    Args:
        protocol: the study.
        way: how it is run, and what to do instead, for the message.
        group: of the participant; None: any.
        at_one_machine: how many are there together.

    Raises:
        AllocationError: if several people sit in one world in a block of the group.
    """
    for block, team in list_teams(protocol, group):
        if (seats := len(team.persons)) not in (1, at_one_machine):
            raise AllocationError(f"block {block!r} is for {seats} people, who cannot play together {way}")
