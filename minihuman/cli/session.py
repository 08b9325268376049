"""Commands that run sessions: run, simulate, check, status."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option
from minihuman.cli.waiting import waiting
from minihuman.errors import printable, room_for

if TYPE_CHECKING:
    from typer import Typer

ProtocolFile = Annotated[Path, Argument(help="A protocol's TOML file.")]
DataFolder = Annotated[Path, Option(help="Where sessions are kept.")]


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, run, simulate, check, status)


def run(
    protocol: ProtocolFile,
    participant: Annotated[str | None, Option(help="A code such as sub-07; else the next free slot.")] = None,
    group: Annotated[str | None, Option(help="A group, against the allocation list.")] = None,
    session: Annotated[int, Option(min=1, help="Which of the participant's sessions.")] = 1,
    any_day: Annotated[bool, Option(help="Run a later session however few or many days have passed.")] = False,
    data: DataFolder = Path("sessions"),
    window: Annotated[str, Option(help="auto, pygame, pyglet, or one of your own.")] = "auto",
    fullscreen: Annotated[bool, Option("--fullscreen/--windowed", help="The whole screen or a window.")] = True,
    lsl: Annotated[bool, Option("--lsl", help="Send markers by the Lab Streaming Layer too.")] = False,
) -> None:
    """Run a participant's session, or the rest of one that was cut short.

    Example: minihuman run protocols/fourrooms-transfer.toml --participant sub-07
    """
    from minihuman.lab.legible import refuse_unreadable
    from minihuman.lab.next_session import next_session
    from minihuman.lab.protocol_file import read_protocol
    from minihuman.seats.agent_seat import agent_seat
    from minihuman.seats.machine import SessionClock
    from minihuman.seats.sitting import ending, sit
    from minihuman.seats.warm_up import warm_up
    from minihuman.windows.choose import open_window

    study = read_protocol(protocol)
    with waiting(f"getting the worlds of {study.study.name} ready"):
        warm_up(study, str(protocol))
        refuse_unreadable(study, str(protocol))
    clock = SessionClock()
    opened = open_window(window, clock, fullscreen=fullscreen)
    try:  # the window first: a station without a display must not use up a slot
        plan = next_session(study, data, participant=participant, group=group, session=session, any_day=any_day)
        group_said = f"group {plan.participant.group}" if plan.participant.group else "group still to be drawn"
        print(f"{plan.participant.id}, {group_said}, from episode {plan.first_episode + 1}", flush=True)
        log = sit(plan, opened, clock, data, markers=lsl, agent=agent_seat(study, plan, data))
    finally:
        opened.close()
    if log is None:
        before = "the group was drawn" if plan.participant.group == "" else "a consent was given"
        print(f"it ended before {before}: nothing was written, and the slot is free again")
        return
    print(ending(log, protocol))
    print(log)


def simulate(
    protocol: ProtocolFile,
    participants: Annotated[int, Option(min=1, help="How many, in the next free slots.")] = 10,
    data: DataFolder = Path("sessions"),
    seed: Annotated[int, Option(min=0, help="Every choice of the players derives from it.")] = 0,
    player: Annotated[
        str, Option(help="human-like, optimal, random, supervisor; human-like:lapse=0.1 sets one up.")
    ] = ("human-like"),
) -> None:
    """Let simulated participants play a study: the same session, no window, no waiting.

    Example: minihuman simulate protocols/fourrooms-transfer.toml --participants 10 --data /tmp/trial
    """
    from minihuman.lab.protocol_file import read_protocol
    from minihuman.seats.simulate import simulate as play
    from minihuman.seats.warm_up import shared, warm_up

    study = read_protocol(protocol)
    with (
        waiting(f"{player} plays {study.study.name}") as say,
        shared(study.blocks, plans=not player.startswith("random")) as companion,
    ):
        warm_up(study, str(protocol), companion)
        for block in study.blocks:
            companion.compile_plan(block)
        for number, path in enumerate(play(study, data, participants=participants, seed=seed, player=player), 1):
            print(path, flush=True)
            say(f"{player} plays {study.study.name}: {number} of {participants} participants done")


def check(
    protocol: ProtocolFile,
    participant: Annotated[str, Option(help="Whose plan to print.")] = "sub-01",
    group: Annotated[str | None, Option(help="A group, against the allocation list.")] = None,
    stratum: Annotated[str | None, Option(help="Whose answer; else the first stratum.")] = None,
    session: Annotated[int, Option(min=1, help="Which of the participant's sessions.")] = 1,
    json: Annotated[bool, Option("--json", help="Print the whole plan as JSON.")] = False,
    pictures: Annotated[Path | None, Option(help="Draw every screen into this folder, too.")] = None,
    preregistration: Annotated[Path | None, Option(help="Write what registries ask for into this file.")] = None,
    effect: Annotated[str, Option(help="With --preregistration: excess=0.7 works out its power.")] = "",
) -> None:
    """Check a protocol and its worlds, and print everything that a participant will play.

    Example: minihuman check protocols/fourrooms-transfer.toml --participant sub-07
    """
    import msgspec

    from minihuman.data.exclusions import check_measures
    from minihuman.lab.legible import refuse_unreadable
    from minihuman.lab.protocol_file import read_protocol
    from minihuman.study.dry_run import lines, strata_lines
    from minihuman.study.expand import enrol, expand, participant_index
    from minihuman.study.rehearse import rehearse

    study = read_protocol(protocol)
    check_measures(study.exclusions, str(protocol))
    rehearse(study, str(protocol))
    who = enrol(study, participant_index(participant), group, stratum=stratum)
    plan = expand(study, who, session=session, overridden=group is not None)
    refuse_unreadable(study, str(protocol))
    print(msgspec.json.encode(plan).decode() if json else printable("\n".join((*lines(plan), *strata_lines(study)))))
    if pictures is not None:
        from minihuman.seats.screens import save_screens

        with waiting("drawing every screen"), room_for(pictures):
            drawn = list(save_screens(plan, pictures))
        print(f"{len(drawn) - 1} screens in {pictures}; all at a glance in {drawn[-1]}")
    if preregistration is not None:
        from minihuman.power.preregistration import power_of, write

        with waiting("writing the preregistration"):
            power = power_of(protocol.read_bytes(), effect) if effect else ""
        print(write(study, plan, preregistration, power))


def status(
    study_dir: Annotated[Path, Argument(help="A study's folder, such as sessions/fourrooms-transfer.")],
    due: Annotated[bool, Option("--due", help="Only of whom a session is expected, or the rest of one.")] = False,
    json: Annotated[bool, Option("--json", help="Print JSON instead of lines; with --due.")] = False,
) -> None:
    """Say who has taken part, how far each session came, and which were cut off.

    Example: minihuman status sessions/fourrooms-transfer --due
    """
    from minihuman.lab.status import status_lines

    if due:
        from datetime import UTC, datetime

        import msgspec

        from minihuman.lab.due import due as expected

        found = expected(study_dir, datetime.now(UTC).date())
        told = [one.line() for one in found] or ["nobody is due"]
        print(msgspec.json.encode(found).decode() if json else printable("\n".join(told)))
        return
    for line in status_lines(study_dir):
        print(printable(line))
