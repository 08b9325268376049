"""Commands for planning and publishing: export, power, fit, payments."""

from pathlib import Path
from typing import Annotated, Any

from minihuman.cli.options import (
    Argument,
    JsonOption,
    Option,
    ProtocolFile,
    StudyFolder,
    StudyOrLog,
    TrustOption,
    ask_trust,
    print_account,
    print_json,
    selection_options,
    show_progress,
)
from minihuman.errors import ExportError, MinihumanError


@selection_options()
def export(
    format_name: Annotated[
        str,
        Argument("csv, parquet, minari, lerobot, imitation, bids, psych-ds, frictionless or croissant.", "FORMAT"),
    ],
    study: StudyOrLog,
    folder: Annotated[Path | None, Argument("The same as --out.", "[OUT]")] = None,
    out: Annotated[Path | None, Option(help="The folder of the export; it must not exist yet.")] = None,
    stored_frames: Annotated[
        bool, Option("--stored-frames", help="Use the observations in the logs; do not replay.")
    ] = False,
    *,
    selection: Any,
) -> None:
    """Export a study as tables, demonstrations or an archive.

    Example: minihuman export minari sessions/fourrooms-transfer --outcome goal --out demos
    """
    from minihuman.workflow import export as export_study

    if (out is None) == (folder is None):
        raise ExportError("the output folder is given once; add --out FOLDER, or remove one of the two")
    out = out or folder
    assert out is not None
    with show_progress("exporting") as progress:
        done = export_study(
            format_name, study, out, selection=selection, stored_frames=stored_frames, on_progress=progress
        )
    print_account(done.notes)
    print(f"{done.episodes} episodes, {done.steps} steps in {out}; see {out / 'README.md'}")


def power(
    protocol: ProtocolFile,
    effect: Annotated[str, Option(help="The effect: excess=0.7 (30 % fewer excess steps in one group) or none.")],
    groups: Annotated[str, Option(help="The numbers of participants per group to try.")] = "10,20,30,40",
    measure: Annotated[str, Option(help="The measure to test, or `all`.")] = "log_excess_steps",
    block: Annotated[str | None, Option(help="The block to analyse; by default the last.")] = None,
    studies: Annotated[int, Option(min=10, help="The number of studies to simulate for each group size.")] = 1000,
    people: Annotated[
        int, Option(min=4, help="The number of simulated participants from which studies are drawn.")
    ] = 60,
    player: Annotated[
        str, Option(help="The kind of simulated participant, as for `minihuman simulate`.")
    ] = "human-like",
    seed: Annotated[int, Option(min=0, help="The random seed.")] = 1,
    out: Annotated[Path | None, Option(help="The folder of the table and the figure.")] = None,
    trust: TrustOption = False,
    json: JsonOption = False,
) -> None:
    """Estimate the power of a study by simulation.

    Use the same statistical test as the report.

    Example: minihuman power protocols/fourrooms-transfer.toml --effect excess=0.7 --groups 10,20,30,40
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.planning.pool import parse_group_sizes, simulate_pool
    from minihuman.planning.power import (
        MEASURES,
        TWO_PARTS,
        Effect,
        compute_values,
        describe_power,
        power_curve,
        write_power,
    )

    sizes, wanted = parse_group_sizes(groups), Effect.parse(effect)
    toml = read_protocol(protocol, trust=ask_trust(trust)).toml
    pool = simulate_pool(toml, people=people, player=player, seed=seed, block=block)
    found = tuple(
        one
        for name in ((*MEASURES, TWO_PARTS) if measure == "all" else (measure,))
        for one in power_curve(
            name,
            compute_values(wanted.of(pool.episodes), name),
            compute_values(pool.episodes, name),
            sizes,
            studies=studies,
            seed=seed,
        )
    )
    if json:
        print_json(found)
    else:
        print(describe_power(pool, wanted, found, player=player))
    print_account(map(str, write_power(found, out) if out is not None else ()))


def fit(
    study: StudyFolder,
    out: Annotated[Path | None, Option(help="The CSV file of all values and intervals.")] = None,
    json: JsonOption = False,
) -> None:
    """Fit the reaction times of simulated participants to logged ones.

    Print the fitted parameters of each participant, their medians, and how well they predict held-out episodes.

    Example: minihuman fit sessions/fourrooms-transfer --out people.csv
    """
    from minihuman.dataset.sessions import StudySessions
    from minihuman.planning.reaction_time_fit import describe_fits, fit_participants, write_fits

    times = list(fit_participants(StudySessions(study)))
    if json:
        print_json(times)
    else:
        print("\n".join(describe_fits(times)))
    print_account([str(write_fits(times, out))] if out is not None else [])


def payments(
    study: StudyFolder,
    platform: Annotated[str, Option(help="Print id,amount for this platform: prolific, sona or mturk.")] = "",
    json: JsonOption = False,
) -> None:
    """Print what each session earned, as CSV.

    Each row has the participant's id on the recruitment platform.

    Example: minihuman payments sessions/two-days --platform prolific > payments.csv
    """
    from minihuman.admin.payments import compute_payments, format_payments_csv, format_platform_payments

    if platform and json:
        raise MinihumanError(f"--platform {platform} prints the platform's own CSV; remove --json")
    paid = compute_payments(study)
    if json:
        print_json(list(paid))
        return
    print(format_platform_payments(paid, platform) if platform else format_payments_csv(paid), end="")
