"""Sentences for the methods section on orders of parts, teams and adaptive designs."""

from collections.abc import Iterator, Sequence

from minihuman.experiment.protocol.model import BlockSpec, GroupSpec, Protocol
from minihuman.experiment.protocol.specs import OrderSpec


def describe_orders(protocols: Sequence[Protocol]) -> list[str]:
    """Return a paragraph on how the orders of parts were balanced or drawn; [] if all participants had one order."""
    sentences = dict.fromkeys(
        _describe_order(order, has_groups=len(protocol.groups) > 1)
        for protocol in protocols
        for order in protocol.orders
        if order.order != "fixed"
    )
    if not sentences:
        return []
    return [" ".join(sentences)]


def describe_group_parts(protocols: Sequence[Protocol]) -> list[str]:
    """Return a sentence for each protocol whose groups had different parts; [] if there is none."""
    sentences = dict.fromkeys(sentence for protocol in protocols for sentence in _list_group_parts(protocol))
    return list(sentences)


def _list_group_parts(protocol: Protocol) -> Iterator[str]:
    """Yield one sentence with the parts of each group, if they differ."""
    parts = {group.name: _name_parts(protocol, group) for group in protocol.groups}
    if len(set(parts.values())) > 1:
        yield f"Parts by group: {'; '.join(f'{group} had {names}' for group, names in parts.items())}."


def _name_parts(protocol: Protocol, group: GroupSpec) -> str:
    """Return the names of a group's parts as text, by session if there are several sessions."""
    sessions = [session.parts for session in protocol.sessions] or [group.parts or group.blocks]
    names_by_session = []
    for parts in sessions:
        replaced = [group.replace_parts.get(name, name) for name in parts]
        names_by_session.append(", ".join(name for name in replaced if name) or "none")
    if len(names_by_session) == 1:
        return names_by_session[0]
    return " and ".join(f"in session {number} {names}" for number, names in enumerate(names_by_session, 1))


def _describe_order(order: OrderSpec, *, has_groups: bool) -> str:
    """State how the order of some parts was drawn, or balanced by Latin squares, between participants."""
    units = list(_name_units(order))
    parts = f"{', '.join(units[:-1])} and {units[-1]}"
    if order.order == "shuffled":
        return f"The order of {parts} was drawn for each participant."
    people = "participants of a group" if has_groups else "participants"
    n_units = len(units)
    if n_units % 2 == 0:
        squares = f"a Latin square (Williams, 1949) for each {n_units} successive {people}"
    else:
        squares = f"two Latin squares (Williams, 1949) for each {2 * n_units} successive {people}"
    return f"The order of {parts} followed {squares}."


def _name_units(order: OrderSpec) -> Iterator[str]:
    """Yield a name for each unit whose place in the order varies: its first part, with further parts in brackets."""
    for first, *following in order.units:
        if following:
            yield f"{first} (with {', '.join(following)})"
        else:
            yield first


def name_allocated(protocols: Sequence[Protocol], *, has_groups: bool, has_keys: bool) -> str:
    """Return the words for what the allocation list assigned: groups, keys, orders or only slots.

    It assigns no group if an adaptive design does, or if the study has only one group. ``has_groups`` says whether the
    sessions were of several groups, and ``has_keys`` whether keys were drawn.
    """
    by_design = any(protocol.allocation.design for protocol in protocols)
    has_groups = has_groups or any(len(protocol.groups) > 1 for protocol in protocols)
    if has_groups and not by_design:
        return "Groups and keys" if has_keys else "Groups"
    if has_keys:
        return "Keys"
    has_orders = any(order.order != "fixed" for protocol in protocols for order in protocol.orders)
    return "Orders" if has_orders else "Slots"


def describe_team(spec: BlockSpec | None) -> str:
    """Return a clause on how many people and which agents play a block together; "" for fewer than two players."""
    if spec is None or spec.team is None or len(spec.team.seats) < 2:
        return ""
    n_people = len(spec.team.persons)
    agents = [kind for seat, kind in enumerate(spec.team.seats) if seat not in spec.team.persons]
    if not agents:
        return f"; played by teams of {n_people} people"
    people = "one person" if n_people == 1 else f"{n_people} people"
    return f"; played by {people} together with {' and '.join(agents)}"


def describe_adaptive_designs(protocols: Sequence[Protocol]) -> list[str]:
    """Return a paragraph on the protocols' adaptive designs; [] if nothing was adaptive."""
    sentences: dict[str, None] = {}
    for protocol in protocols:
        for opening, spec in (
            ("Groups were assigned by", protocol.allocation.design),
            ("Enrolment could be stopped by", protocol.allocation.stopping),
            *((f"Episodes of block {block.name} were chosen by", block.design) for block in protocol.blocks),
        ):
            if spec is None:
                continue
            name = spec.name
            if spec.settings:
                settings = ", ".join(f"{setting} = {value!r}" for setting, value in spec.settings.items())
                name = f"{spec.name} ({settings})"
            sentences[f"{opening} the adaptive design {name}."] = None
    if not sentences:
        return []
    proof = "Each decision is recorded with what it followed from, and verification asks the design again."
    return [" ".join([*sentences, proof])]
