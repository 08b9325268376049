"""Commands to get started with: demo, new, check, doctor, play, worlds."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from minihuman.cli.options import (
    Argument,
    DataFolder,
    JsonOption,
    Option,
    ProtocolFile,
    TrustOption,
    ask_trust,
    has_display,
    print_result,
    show_progress,
)
from minihuman.errors import MinihumanError, name_output_when_full

if TYPE_CHECKING:
    from minihuman.admin.protocol_file import ProtocolDraft
    from minihuman.experiment.plan.session_plan import SessionPlan
    from minihuman.experiment.protocol.protocol import Protocol


WindowOption = Annotated[str, Option("--window", help="The kind of window: auto, pygame, pyglet or a plug-in's name.")]
FullscreenOption = Annotated[bool, Option("--fullscreen", help="Run in full screen.")]
LoopbackOption = Annotated[
    bool,
    Option(
        "--loopback",
        help="Measure how late clicks come back through a cable from the headphone output to the sound input.",
    ),
]
PhotodiodeOption = Annotated[
    bool,
    Option(
        "--photodiode",
        help="Measure how late pictures change, with a photodiode on the screen, connected to the sound input.",
    ),
]


def demo(
    data: DataFolder = Path("sessions"),
    window: WindowOption = "auto",
    fullscreen: FullscreenOption = False,
) -> None:
    """Play a short session, then look at its log, figures and replay.

    Example: minihuman demo
    """
    from minihuman.runtime.demo import run_demo

    paths = {}
    for name, path in run_demo(data, window=window, fullscreen=fullscreen, say=print):
        paths[name] = path
        print(f"{name:16} {path}", flush=True)
    print(f"Look at it: minihuman replay {paths['log']}")


def new(
    folder: Annotated[Path, Argument("The folder of the new file; created if it does not exist.", "FOLDER")] = Path(),
    name: Annotated[str, Option(help="The study's name.")] = "",
    world: Annotated[
        str, Option(help="Gymnasium IDs of worlds, with commas; `minihuman worlds` lists the built-in ones.")
    ] = "",
    template: Annotated[
        str,
        Option(help="Begin from two-groups, two-days, three-groups, trials, browser or team; several with commas."),
    ] = "",
    language: Annotated[
        str, Option(help="The language of the study: en, de, fr, es, zh, ja, ar, he, or another.")
    ] = "en",
    episodes: Annotated[int, Option(help="The number of episodes in each block.", min=1)] = 5,
    participants: Annotated[int, Option(help="The number of participants.", min=1)] = 20,
    yes: Annotated[bool, Option("--yes", "-y", help="Ask no questions; use the defaults.")] = False,
) -> None:
    """Write a ready-to-run protocol after a few questions.

    Without any option, and where there is a display, the builder opens instead, on which a study is made by hand.

    Example: minihuman new my-study --template two-days,three-groups --language he
    """
    from minihuman.admin.protocol_file import ProtocolDraft, make_study_name
    from minihuman.builder.new_study import write_draft
    from minihuman.errors import ProtocolError

    templates = tuple(name.strip() for name in template.split(",") if name.strip())
    study = make_study_name(name or "my-study")
    defaults = ProtocolDraft(study, world, episodes, participants, templates=templates, language=language)
    if not yes and not name and defaults == ProtocolDraft() and sys.stdin.isatty() and has_display():
        from minihuman.cli.run import open_desk

        folder.mkdir(parents=True, exist_ok=True)
        open_desk(folder, Path("sessions"), page="builder/")
        return
    draft = defaults
    if not yes:
        draft = _ask_draft(defaults)
    path = folder / f"{draft.name}.toml"
    if path.exists():
        raise ProtocolError(f"{path} already exists; choose another name with --name, or another folder")
    write_draft(draft, folder)
    if draft.has("two-groups"):
        start = f"serve {path} --links {draft.participants}"
    elif {"browser", "team"} & {*templates}:
        start = f"serve {path}"
    else:
        start = f"run {path} --windowed"
    for line in draft.describe_outcomes():
        print(line)
    print(f"{path} is a study that runs:\n  minihuman check {path}\n  minihuman {start}")


def _ask_draft(defaults: "ProtocolDraft") -> "ProtocolDraft":
    """Ask the questions that define a new study, with default answers, and return a draft with the answers.

    Raises:
        SystemExit: with status 1, if the user aborts.
    """
    import click

    from minihuman.admin.protocol_file import make_study_name

    try:
        name = make_study_name(click.prompt("Name of the study", default=defaults.name))
        world = click.prompt("Worlds, with commas (`minihuman worlds` lists ours)", default=",".join(defaults.worlds))
        episodes = click.prompt("Episodes each", default=defaults.episodes, type=int)
        participants = click.prompt("Participants", default=defaults.participants, type=int)
        show_keys = not defaults.templates and click.confirm("Show which key does what?", default=False)
    except click.Abort:
        print("Aborted.", file=sys.stderr)
        raise SystemExit(1) from None
    keys = "shown" if show_keys else "new"
    return replace(defaults, name=name, world=world, episodes=episodes, participants=participants, keys=keys)


def check(
    protocol: ProtocolFile,
    participant: Annotated[str, Option(help="Print the plan for this participant.")] = "sub-01",
    group: Annotated[str | None, Option(help="Use this group instead of the allocated one.")] = None,
    stratum: Annotated[str | None, Option(help="Plan for this stratum; by default, for the first one.")] = None,
    session: Annotated[
        int | None,
        Option(min=1, help="The session to show, such as 2; by default, the plan of the first and pictures of all."),
    ] = None,
    json: Annotated[bool, Option("--json", help="Print the whole plan as JSON.")] = False,
    pictures: Annotated[Path | None, Option(help="Save a picture of every screen to this folder.")] = None,
    preregistration: Annotated[Path | None, Option(help="Write a preregistration to this file.")] = None,
    effect: Annotated[
        str, Option(help="Add a power estimate for this effect, such as excess=0.7, to the --preregistration file.")
    ] = "",
    trust: TrustOption = False,
) -> None:
    """Check a protocol and its worlds, and print a session plan.

    Example: minihuman check protocols/fourrooms-transfer.toml --participant sub-07
    """
    from minihuman.admin.legibility import require_legible
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.dataset.selection import check_exclusion_measures
    from minihuman.experiment.plan.dry_run import (
        check_worlds,
        describe_plan,
        describe_strata,
        describe_worlds,
    )
    from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
    from minihuman.experiment.plan.outcome_check import check_outcome_rules
    from minihuman.experiment.plan.participant_codes import parse_participant_code
    from minihuman.experiment.plan.protocol_notices import list_protocol_notices

    if effect and preregistration is None:
        raise MinihumanError(f"--effect {effect} only adds to a preregistration; add --preregistration FILE as well")
    study = read_protocol(protocol, trust=ask_trust(trust))
    check_exclusion_measures(study.exclusions, str(protocol))
    notices = check_worlds(study, str(protocol), provable=True)
    outcomes = check_outcome_rules(study, str(protocol))
    enrolled = enrol_participant(study, parse_participant_code(participant), group, stratum=stratum)
    sessions = [session] if session else range(1, max(1, len(study.sessions)) + 1)  # one if none is declared
    plans = [expand_protocol(study, enrolled, session=number, overridden=group is not None) for number in sessions]
    plan = plans[0]
    require_legible(study, str(protocol))
    lines = (
        *describe_plan(plan),
        *describe_strata(study),
        *list_protocol_notices(study),
        *outcomes,
        *describe_worlds(study, notices),
    )
    print_result(plan, lambda: "\n".join(lines), json=json)
    if pictures is not None:
        _save_pictures(study, plans, pictures)
    if preregistration is not None:
        _write_preregistration(study, plan, preregistration, effect)


def _save_pictures(study: "Protocol", plans: "list[SessionPlan]", pictures: Path) -> None:
    """Save a picture of every screen of planned sessions to a folder, and print a summary."""
    from minihuman.runtime.screenshots import save_screenshots

    with show_progress("drawing every screen"), name_output_when_full(pictures):
        screenshots = save_screenshots(plans, pictures)
    group_note = ""
    if len(study.groups) > 1:
        group_note = f" (of group {plans[0].participant.group}; --group draws another's)"
    print(f"{len(screenshots.screens)} screens{group_note} in {pictures}; all at a glance in {screenshots.sheet}")
    if screenshots.missing:
        missing = ", ".join(screenshots.missing)
        print(f"not drawn, as no simulated participant reaches them: {missing}", file=sys.stderr)


def _write_preregistration(study: "Protocol", plan: "SessionPlan", path: Path, effect: str) -> None:
    """Write a preregistration and print its path; include a power estimate if an effect is given."""
    from minihuman.planning.preregistration import describe_planned_power, write_preregistration

    power = ""
    with show_progress("writing the preregistration"):
        if effect:
            power = describe_planned_power(study.toml, effect)
    print(write_preregistration(study, plan, path, power))


def doctor(
    protocol: Annotated[Path | None, Argument("A protocol's TOML file; its worlds are drawn too.", "PROTOCOL")] = None,
    data: DataFolder = Path("sessions"),
    window: WindowOption = "auto",
    fullscreen: Annotated[
        bool | None,
        Option(
            "--fullscreen/--windowed", help="Test in full screen (the default if a protocol is given) or in a window."
        ),
    ] = None,
    loopback: LoopbackOption = False,
    photodiode: PhotodiodeOption = False,
    trust: TrustOption = False,
    json: JsonOption = False,
) -> None:
    """Check whether this machine can run sessions with participants.

    The exit status is 1 if any check fails.

    Example: minihuman doctor protocols/fourrooms-transfer.toml
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.runtime.device_delays import DelayChecks
    from minihuman.runtime.doctor import examine_machine, format_verdict

    if protocol is None:
        study = None
    else:
        study = read_protocol(protocol, trust=ask_trust(trust))
    if fullscreen is None:
        fullscreen = study is not None
    findings = []
    delays = DelayChecks(loopback, photodiode)
    for finding in examine_machine(window=window, data=data, fullscreen=fullscreen, protocol=study, delays=delays):
        findings.append(finding)
        if not json:
            print(finding.line(), flush=True)
    print_result(findings, lambda: format_verdict(findings), json=json)
    raise SystemExit(int(any(finding.unfit_because for finding in findings)))


def play(
    world_id: Annotated[
        str, Argument("The Gymnasium ID of the world; `minihuman worlds` lists the built-in ones.", "WORLD")
    ],
    seed: Annotated[int, Option(min=0, help="The random seed of the first layout.")] = 0,
    view: Annotated[
        Literal["partial", "full"], Option(help="Show what the agent sees (partial) or the whole grid (full).")
    ] = "partial",
    palette: Annotated[Literal["classic", "colour-safe"], Option(help="The colour palette of the world.")] = "classic",
    window: WindowOption = "auto",
    fullscreen: FullscreenOption = False,
) -> None:
    """Play a world by hand; nothing is recorded.

    Example: minihuman play minihuman/MiniGrid-FourRooms-v0
    """
    from contextlib import closing
    from time import perf_counter_ns

    from minihuman.display.windows.blocking_window import open_window
    from minihuman.runtime.demo import FreePlay, run_free_play

    with closing(open_window(window, perf_counter_ns, fullscreen=fullscreen)) as opened:
        run_free_play(FreePlay(world_id, seed, view, palette), opened, perf_counter_ns)


def worlds(json: JsonOption = False) -> None:
    """List the built-in worlds.

    Example: minihuman worlds
    """
    from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS

    listed = [{"id": entry.id, "summary": entry.summary} for entry in (*WORLDS, *TEAM_WORLDS)]
    print_result(listed, lambda: "\n".join(f"{world['id']:60} {world['summary']}" for world in listed), json=json)
