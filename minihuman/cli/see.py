"""Commands that show data: replay, plot, mark, report."""

import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from minihuman.cli.choosing import choosing, say
from minihuman.cli.declared import Argument, Option
from minihuman.collector import seldom_collected
from minihuman.errors import room_for

if TYPE_CHECKING:
    from typer import Typer

Logs = Annotated[list[Path], Argument(help="Session logs, or their folders.", metavar="LOG...")]


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, replay, plot, mark, report, query)


@choosing(with_=("unfinished", "rules"))
def replay(
    logs: Logs,
    save: Annotated[Path | None, Option(help="Write the recording here and open nothing.")] = None,
    web: Annotated[bool, Option("--web", help="Show it in the browser, served on 127.0.0.1 only.")] = False,
    view: Annotated[bool, Option(help="Draw what the participant saw, checked against the log.")] = False,
    *,
    selection: Any,
) -> None:
    """Replay sessions in rerun: paths, keys, rewards and events on common timelines.

    Episodes that were not finished, or that the protocol's rules leave out, are shown too; those marked exclude are
    not. What cannot be read is named and left out.

    Example: minihuman replay sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap --save replay.rrd
    """
    from minihuman.data.study import readable
    from minihuman.replay.recording import save_recording
    from minihuman.replay.viewer import show

    sessions, account = readable(logs, selection)
    say(account.lines())
    if save is not None:
        print(save_recording(sessions, save, with_view=view))
        return
    with tempfile.TemporaryDirectory() as folder:
        show(save_recording(sessions, Path(folder) / "replay.rrd", with_view=view), web=web)


@choosing()
def plot(
    source: Annotated[Path, Argument(help="A session log, or a folder of them.", metavar="SRC")],
    out: Annotated[Path, Option(help="Folder for the figures.")],
    each: Annotated[bool, Option("--each", help="Of a folder: every session's paths and overview too.")] = False,
    *,
    selection: Any,
) -> None:
    """Draw a session's paths and overview; of a study where everybody was and how they learnt. As PNG and PDF.

    Example: minihuman plot sessions/demo --out figures --each
    """
    with seldom_collected():
        from minihuman.data.study import Sessions
        from minihuman.figures.gallery import draw_all

        sessions = Sessions(source, selection)
        with room_for(out):
            for path in draw_all(sessions, out, each=each):
                print(path, flush=True)
        say(sessions.account.lines())


def mark(
    log: Annotated[Path, Argument(help="A session log.", metavar="LOG")],
    tag: Annotated[str, Option(help='One word, such as "exclude".')],
    episode: Annotated[int | None, Option(help="Number as in the figures; the whole session if absent.")] = None,
    note: Annotated[str, Option(help="Why.")] = "",
    take_back: Annotated[bool, Option("--take-back", help="Undo an earlier mark of this tag.")] = False,
) -> None:
    """Mark an episode, or a whole session, in a file beside the log; the log itself stays as it is.

    Example: minihuman mark sub-01_ses-01.mcap --episode 3 --tag exclude --note "the phone rang"
    """
    from minihuman.data.marks import Mark, add_mark
    from minihuman.log.read.open_log import open_log

    at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    print(add_mark(open_log(log), Mark(tag, at, episode=episode, note=note, taken_back=take_back)))


@choosing()
def report(
    study: Annotated[Path, Argument(help="A study's folder.", metavar="STUDY")],
    out: Annotated[Path, Option(help="Folder for the page, the tables and the figures.")],
    *,
    selection: Any,
) -> None:
    """Write a study's tables, statistics and figures, and one page that holds them all.

    Example: minihuman report sessions/fourrooms-transfer --out report
    """
    with seldom_collected():
        from minihuman.data.study import Sessions
        from minihuman.report.build import build, of_another_report

        sessions = Sessions(study, selection)
        with room_for(out):
            written = build(sessions, out)
        for path in written:
            print(path, flush=True)
        say((*sessions.account.lines(), *of_another_report(out, written)))


def query(
    study: Annotated[Path, Argument(help="A study's folder.", metavar="STUDY")],
    sql: Annotated[str, Argument(help="What to ask of its tables, in DuckDB's SQL.", metavar="SQL")],
    csv: Annotated[bool, Option("--csv", help="Print every row as CSV.")] = False,
) -> None:
    """Ask a study's tables anything: steps, episodes, participants and the others, as an export or a report has them.

    Rows that do not count are there too: where left_out is null stand those that do. The tables are kept in
    tables.duckdb in the study's folder, a cache that may be deleted at any time.

    Example: minihuman query sessions/demo "select participant, avg(reward) from episodes group by all"
    """
    from minihuman.data.answer import as_csv, as_lines
    from minihuman.data.store import Store
    from minihuman.data.study import Sessions

    sessions = Sessions(study)
    with Store(sessions, with_shortest=True) as store:
        found = store.tables.query(sql)
    print(as_csv(found) if csv else "\n".join(as_lines(found)), end="" if csv else "\n")
    say(one.line() for one in sessions.account.skipped)
