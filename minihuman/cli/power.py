"""How many participants a study needs, and who they are: power, fit."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option

if TYPE_CHECKING:
    from typer import Typer


def add_to(app: "Typer") -> None:
    """Add this command."""
    from minihuman.cli.typed import add

    add(app, power, fit)


def power(
    protocol: Annotated[Path, Argument(help="The study's TOML file.")],
    effect: Annotated[str, Option(help="excess=0.7 for 30 % fewer excess steps in one group; or none.")],
    groups: Annotated[str, Option(help="Participants a group to try.")] = "10,20,30,40",
    measure: Annotated[str, Option(help="A measure, or all.")] = "log_excess_steps",
    block: Annotated[str | None, Option(help="The block to look at; by default the last.")] = None,
    studies: Annotated[int, Option(min=10, help="How many studies to draw of each size.")] = 1000,
    people: Annotated[int, Option(min=4, help="How many simulated people to draw them from.")] = 60,
    player: Annotated[str, Option(help="Who plays.")] = "human-like",
    seed: Annotated[int, Option(help="Of the people and of the studies drawn.")] = 1,
    out: Annotated[Path | None, Option(help="A folder for the table as CSV and the figure.")] = None,
) -> None:
    """Say how likely a study of so many participants finds an effect, with the report's own test.

    Example: minihuman power protocols/fourrooms-transfer.toml --effect excess=0.7 --groups 10,20,30,40
    """
    from minihuman.power.pool import groups_of, play_pool
    from minihuman.power.studies import MEASURES, TWO_PARTS, Effect, power_curve, values_of
    from minihuman.power.told import told, write

    sizes, wanted = groups_of(groups), Effect.parse(effect)
    pool = play_pool(protocol.read_bytes(), people=people, player=player, seed=seed, block=block)
    found = tuple(
        one
        for name in ((*MEASURES, TWO_PARTS) if measure == "all" else (measure,))
        for one in power_curve(
            name,
            values_of(wanted.of(pool.episodes), name),
            values_of(pool.episodes, name),
            sizes,
            studies=studies,
            seed=seed,
        )
    )
    print(told(pool, wanted, found, player=player))
    for path in write(found, out) if out is not None else ():
        print(path)


def fit(
    study_dir: Annotated[Path, Argument(help="A study's folder, such as sessions/fourrooms-transfer.")],
    out: Annotated[Path | None, Option(help="A CSV file for everybody's values and intervals.")] = None,
    search: Annotated[int, Option(min=0, help="Simulated people to tell from how people look; 0: times alone.")] = 200,
    seed: Annotated[int, Option(help="Of the simulated people.")] = 1,
) -> None:
    """Fit a simulated person to logged people, reaction times and search, and say how well held-out episodes are told.

    Example: minihuman fit sessions/fourrooms-transfer --out people.csv
    """
    from minihuman.data.study import Sessions
    from minihuman.power import fitting, search_fit

    times = list(fitting.fit_people(Sessions(study_dir)))
    print("\n".join(fitting.lines(times)))
    looking = search_fit.fit_search(Sessions(study_dir), people=search, seed=seed) if search else None
    if looking is not None:
        print("\n".join(search_fit.lines(looking)))
    if out is not None:
        print(fitting.write(times, out, looking))
