"""Makes the host through which a session takes part in the teams of its process."""

from minihuman.runtime.session_hosts import HostContext
from minihuman.runtime.team_host import TeamMember, TeamTable


def make_team_member(context: HostContext) -> TeamMember:
    """Make the host of a session that plays in teams."""
    table = context.teams or TeamTable(context.protocol, context.data)
    return TeamMember(table, context.plan, patient=context.patient, changed=context.changed, signs=context.signs)
