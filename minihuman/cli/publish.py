"""Commands for planning and publishing: export, publish, power, fit, payments, pack."""

from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from minihuman.cli.options import (
    Argument,
    EngineOption,
    JsonOption,
    Option,
    ProtocolFile,
    StudyFolder,
    StudyOrLog,
    TrustOption,
    ask_trust,
    print_account,
    print_json,
    print_result,
    selection_options,
    show_progress,
)
from minihuman.errors import ExportError, MinihumanError, ReportError, name_output_when_full


@selection_options()
def export(
    format_name: Annotated[
        str,
        Argument("csv, parquet, minari, lerobot, bids or another; `minihuman plugins` lists all.", "FORMAT"),
    ],
    study: StudyOrLog,
    folder: Annotated[Path | None, Argument("The same as --out.", "OUT")] = None,
    out: Annotated[Path | None, Option(help="The folder to write the export to; it must be new or empty.")] = None,
    stored_frames: Annotated[
        bool, Option("--stored-frames", help="Use the observations stored in the logs instead of replaying episodes.")
    ] = False,
    with_messages: Annotated[
        bool,
        Option(
            "--with-messages",
            help="Also copy the logs that hold messages between participants; BIDS alone contains logs.",
        ),
    ] = False,
    engine: EngineOption = "local",
    *,
    selection: Any,
) -> None:
    """Export a study as tables, demonstrations or an archive.

    Example: minihuman export minari sessions/fourrooms-transfer --outcome goal --out demos
    """
    from minihuman.api import export as export_study

    if (out is None) == (folder is None):
        raise ExportError("give the output folder exactly once, with --out FOLDER")
    out = out or folder
    assert out is not None
    with show_progress("exporting") as progress:
        summary = export_study(
            format_name,
            study,
            out,
            selection=selection,
            stored_frames=stored_frames,
            with_messages=with_messages,
            engine=engine,
            on_progress=progress,
        )
    print_account(summary.notes)
    print(f"{summary.episodes} episodes, {summary.steps} steps in {out}; see {out / 'README.md'}")


@selection_options()
def publish(
    study: StudyFolder,
    archive: Annotated[str, Option("--for", help="The archive: osf, zenodo, hugging-face or openneuro.")],
    out: Annotated[Path, Option(help="The folder to write to; it must be new or empty.")],
    *,
    selection: Any,
) -> None:
    """Write the folder that an archive takes, ready to upload.

    It holds the study in the archive's format, a card, the citation and metadata. What the protocol's [about] does not
    state can be stated in about.toml in the study's folder.

    Example: minihuman publish sessions/fourrooms-transfer --for osf --out for-osf
    """
    from minihuman.api import publish as publish_study
    from minihuman.exporters.publishing import find_archive

    with show_progress("exporting") as progress:
        summary = publish_study(study, archive, out, selection=selection, on_progress=progress)
    print_account(summary.notes)
    print(f"{summary.episodes} episodes, {summary.steps} steps in {out}; read {out / 'README.md'} first")
    print(f"to upload: {find_archive(archive).upload.format(out=out)}")


def power(
    protocol: ProtocolFile,
    effect: Annotated[
        str,
        Option(
            help="The effect: excess=0.7 (30 % fewer excess steps in one group), shift=0.5 (half a standard deviation "
            "of the primary measure, with p-values corrected as in the report), or none."
        ),
    ],
    groups: Annotated[str, Option(help="The numbers of participants per group to try.")] = "10,20,30,40",
    measure: Annotated[str, Option(help="The measure to test, or `all`.")] = "log_excess_steps",
    block: Annotated[str | None, Option(help="The block to analyse; by default, the last one.")] = None,
    studies: Annotated[int, Option(min=10, help="The number of studies to simulate for each group size.")] = 1000,
    people: Annotated[
        int, Option(min=4, help="The number of simulated participants from which studies are drawn.")
    ] = 60,
    player: Annotated[
        str, Option(help="The kind of simulated participant, as for `minihuman simulate`.")
    ] = "human-like",
    seed: Annotated[int, Option(min=0, help="The random seed of the simulation.")] = 1,
    on: Annotated[
        str,
        Option(
            help="The comparison that a shift affects: `groups`, `conditions` (within participants), `interaction` "
            "(of both) or `change` (between days); needs --effect shift=VALUE."
        ),
    ] = "groups",
    drop_out: Annotated[
        float,
        Option(
            "--drop-out",
            min=0,
            help="The probability, at each session, that a participant drops out; needs --effect shift=VALUE.",
        ),
    ] = 0.0,
    out: Annotated[Path | None, Option(help="The folder to write the table and the figure to.")] = None,
    trust: TrustOption = False,
    json: JsonOption = False,
) -> None:
    """Estimate the power of a study by simulation.

    The statistical test is the same as in the report.

    Example: minihuman power protocols/fourrooms-transfer.toml --effect excess=0.7 --groups 10,20,30,40
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.planning.power import (
        MEASURES,
        TWO_PARTS,
        Effect,
        compute_values,
        describe_power,
        parse_group_sizes,
        power_curve,
        simulate_pool,
        write_power,
    )
    from minihuman.planning.report_power import plan_report_power

    sizes = parse_group_sizes(groups)
    study = read_protocol(protocol, trust=ask_trust(trust))
    if effect.startswith("shift="):
        estimates, text = plan_report_power(
            study.toml, effect, sizes, on=on, drop_out=drop_out, studies=studies, people=people, player=player,
            seed=seed, files=study.files,
        )  # fmt: skip
        print_result(estimates, lambda: text, json=json)
        if out is not None:
            print_account(map(str, write_power(estimates, out)))
        return
    if on != "groups" or drop_out:
        raise ReportError(
            f"--on and --drop-out cannot be used with --effect {effect}; use --effect shift=0.5, or remove them"
        )
    assumed = Effect.parse(effect)
    pool = simulate_pool(study.toml, people=people, player=player, seed=seed, block=block)
    affected = assumed.of(pool.episodes)
    measures: tuple[str, ...] = (measure,)
    if measure == "all":
        measures = (*MEASURES, TWO_PARTS)
    estimates_by_measure = []
    for name in measures:
        with_effect = compute_values(affected, name)
        without_effect = compute_values(pool.episodes, name)
        estimates_by_measure.append(power_curve(name, with_effect, without_effect, sizes, studies=studies, seed=seed))
    all_estimates = tuple(chain.from_iterable(estimates_by_measure))
    print_result(all_estimates, lambda: describe_power(pool, assumed, all_estimates, player=player), json=json)
    if out is not None:
        with name_output_when_full(out):
            print_account(map(str, write_power(all_estimates, out)))


def fit(
    study: StudyFolder,
    out: Annotated[Path | None, Option(help="The CSV file to write all values and intervals to.")] = None,
    json: JsonOption = False,
) -> None:
    """Fit simulated participants' reaction times to logged ones.

    Print the fitted parameters of each participant, their medians, and how well they predict held-out episodes.

    Example: minihuman fit sessions/fourrooms-transfer --out people.csv
    """
    from minihuman.dataset.tables import select
    from minihuman.planning.reaction_time_fit import describe_fits, fit_participants, write_fits

    with select(study) as tables:
        fits = list(fit_participants(tables))
    print_result(fits, lambda: "\n".join(describe_fits(fits)), json=json)
    if out is not None:
        with name_output_when_full(out):
            write_fits(fits, out)
        print_account([str(out)])


def payments(
    study: StudyFolder,
    platform: Annotated[
        str, Option(help="Print lines of `id,amount` for this platform: prolific, sona or mturk.")
    ] = "",
    json: JsonOption = False,
) -> None:
    """Print the payment for each session as CSV.

    Each row contains the participant's ID on the recruitment platform.

    Example: minihuman payments sessions/two-days --platform prolific > payments.csv
    """
    from minihuman.admin.payments import compute_payments, format_payments_csv, format_platform_payments

    if platform and json:
        raise MinihumanError(f"--platform {platform} prints CSV in the platform's own format; remove --json")
    amounts = compute_payments(study)
    if json:
        print_json(list(amounts))
        return
    if platform:
        print(format_platform_payments(amounts, platform), end="")
    else:
        print(format_payments_csv(amounts), end="")


def score(
    studies: Annotated[list[Path], Argument("The studies' folders; their models' folders are read, too.", "STUDY...")],
    reference: Annotated[
        str,
        Option(
            help="The player whose score is 1; by default, people or, if none played, the simulated player most like "
            "them."
        ),
    ] = "",
    out: Annotated[Path, Option(help="The folder to write the table and the figure to.")] = Path("scores"),
    seed: Annotated[int, Option(min=0, help="The random seed of the bootstrap.")] = 1,
) -> None:
    """Score people, policies and models on the same levels.

    The intervals allow for differences between people and between levels.

    Example: minihuman score sessions/fourrooms-transfer --out scores
    """
    from minihuman.reporting.scorecard import build_scorecard, format_scorecard, write_scorecard

    with show_progress("scoring"):
        card = build_scorecard(studies, reference=reference, seed=seed)
        paths = write_scorecard(card, out)
    print(format_scorecard(card))
    for path in paths:
        print(path)


def pack(
    worlds: Annotated[
        list[str], Argument("World ids, such as MiniGrid-FourRooms-v0; `minihuman worlds` lists them.", "WORLD...")
    ],
    out: Annotated[Path, Option(help="The folder to write to; files of an earlier pack in it are replaced.")],
    seeds: Annotated[str, Option(help="Seeds of worlds that no page lays out, such as 0-99.")] = "0-99",
) -> None:
    """Pack worlds for web pages that run without a server.

    The folder holds the worlds' compiled rules, their layouts, their pictures, and the JavaScript modules that play
    them. Put it beside your page, on any web host. Grid worlds and BabyAI levels are laid out in the page, from any
    seed. Of first-person worlds and the WFC mazes, it has the first states of the seeds that you name.

    Example: minihuman pack MiniGrid-FourRooms-v0 MiniWorld-Hallway-v0 --seeds 0-49 --out site/worlds
    """
    from minihuman.web.world_pack import pack_worlds, parse_seeds

    packed = pack_worlds(out, parse_seeds(seeds), worlds)
    size_mb = packed.size_bytes / 1e6
    print(f"{len(packed.worlds)} worlds, {size_mb:.1f} MB in {out}")
    if packed.packed_states:
        print(f"seeds {seeds} alone: {', '.join(packed.packed_states)}")


def site(
    protocol: ProtocolFile,
    out: Annotated[Path, Option(help="The folder to write to; files of an earlier site in it are replaced.")],
    collector: Annotated[
        str, Option(help="Where pages send their records: download, jatos, datapipe:EXPERIMENT_ID, or an address.")
    ] = "download",
    slots: Annotated[int, Option(min=0, help="How many allocation slots to write; 0: the study's.")] = 0,
) -> None:
    """Write a static folder that runs a study on any web host.

    Pages record what a served page would send. `minihuman import` runs it through the session again and writes the
    logs, which say that they are consistent, not witnessed.

    Example: minihuman site protocols/fourrooms-transfer.toml --out site --slots 2
    """
    from minihuman.study_site import write_site

    written = write_site(protocol, out, collector=collector, slots=slots)
    print(
        f"slots: {written.slots}, screens of the first: {written.screens}, {written.size_bytes / 1e6:.1f} MB in {out}"
    )
