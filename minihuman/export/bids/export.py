"""``export bids``: events and paths of every session, the logs they came from, tables and figures made of them."""

import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

from minihuman import __version__
from minihuman.data.chosen import ChosenEpisodes
from minihuman.data.columns import NEED_WORLD
from minihuman.data.counted import Counted
from minihuman.data.marks import marks_path
from minihuman.data.store import Store
from minihuman.data.study import Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import ExportError
from minihuman.export.asked import about_of_plan, devices_of_plan
from minihuman.export.bids.dataset import describe, describe_derivatives, task_facts, write_participants
from minihuman.export.bids.events import COLUMNS, events_of, sidecar
from minihuman.export.bids.files import label, subject, write_json, write_tsv
from minihuman.export.bids.motion import write_motion
from minihuman.export.bids.phenotype import Phenotype
from minihuman.export.bids.physio import write_physio
from minihuman.export.port import Written
from minihuman.figures.files import save_png
from minihuman.figures.paths import session_paths
from minihuman.recorded.episode import Episode
from minihuman.study.about import About

_DERIVATIVES = Path("derivatives/minihuman")


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every session that is asked for, a run for each of its segments.

    Raises:
        ExportError: if two studies, or two participants of one label, would lie in one dataset, or what the laboratory
            says of its participants is not what the protocol asks for.
    """
    dataset: _Dataset | None = None
    for counted in chosen.counted():
        dataset = dataset or _Dataset(out, counted)
        dataset.add(counted)
    if dataset is None:
        return Written((), 0, 0)
    again = Sessions(chosen.sessions.source, chosen.sessions.selection)  # the account of the first pass is the card's
    with Store(again, with_shortest=False) as store:
        write_tables(store.tables, out / _DERIVATIVES / "tables", kinds=("csv",), without=NEED_WORLD)
    paths = dataset.finish(chosen.sessions.source)
    return Written((*paths, out / _DERIVATIVES), dataset.episodes, dataset.steps, sessions=dataset.sessions)


class _Dataset:
    """A dataset while it is written."""

    def __init__(self, out: Path, first: Counted) -> None:
        plan = first.log.plan
        self.episodes = self.steps = self.sessions = 0
        self._out, self._study = out, plan.study
        self._about: About = about_of_plan(plan)
        self._task = label(plan.study)
        self._task_facts = task_facts(self._about, plan.study)
        self._labels: dict[str, str] = {}
        self._people: dict[str, dict[str, Any]] = {}
        self._sessions: defaultdict[str, list[dict[str, str]]] = defaultdict(list)
        self._phenotype = Phenotype()
        self._station = first.log.facts

    def add(self, counted: Counted) -> None:
        """Write one session."""
        log, out = counted.log, self._out
        if log.plan.study != self._study:
            raise ExportError(f"{log.path} is of study {log.plan.study!r}, the others of {self._study!r}; export one")
        who = subject(log.plan.participant.id, self._labels)
        session = f"ses-{log.plan.session:02d}"
        stem, folder = f"{who}_{session}_task-{self._task}", out / who / session
        counting = frozenset((episode.number, episode.attempt) for episode in counted.episodes)
        asked = [episode for episode, is_asked in zip(log.episodes, counted.asked, strict=True) if is_asked]
        devices = devices_of_plan(log.plan)
        scans: list[dict[str, str]] = []
        for segment in log.segments:
            theirs = [episode for episode in asked if episode.segment == segment.number]
            rows = events_of(segment, theirs, counting)
            events = folder / "beh" / f"{stem}_run-{segment.number}_events.tsv"
            written = [write_tsv(events, list(COLUMNS), rows)]
            written += write_motion(stem, folder / "motion", segment.number, self._task_facts, segment, theirs)
            written += write_physio(stem, folder / "beh", segment.number, self._task_facts, segment, devices)
            at = segment.started_at.removesuffix("Z")[:26]  # microseconds are the finest that BIDS has
            scans += [{"filename": str(path.relative_to(folder)), "acq_time": at} for path in written]
        write_tsv(folder / f"{who}_{session}_scans.tsv", ["filename", "acq_time"], scans)
        self._keep_log(counted, Path("sourcedata") / who / session)
        self._draw(counted, f"{who}_{session}")
        self._phenotype.add(log, who, session)
        self._sessions[who].append({"session_id": session, "acq_time": log.started_at.removesuffix("Z")[:26]})
        self._people.setdefault(
            who,
            {
                "participant_id": who,
                "code": log.plan.participant.id,
                "group": log.plan.participant.group,
                "player": log.player,
            },
        )
        self._count(counted.episodes)

    def finish(self, source: Path) -> tuple[Path, ...]:
        """Write what describes them all."""
        out = self._out
        stimuli = {
            "SoftwareName": "minihuman",
            "SoftwareVersion": self._station.get("version_minihuman", __version__),
            "OperatingSystem": self._station.get("system", ""),
        }
        presented = {"StimulusPresentation": {name: said for name, said in stimuli.items() if said}}
        write_json(out / f"task-{self._task}_events.json", self._task_facts | presented | sidecar())
        for who, sessions in self._sessions.items():
            write_tsv(out / who / f"{who}_sessions.tsv", ["session_id", "acq_time"], sessions)
        meaning = {"Description": "When the session began, UTC."}
        write_json(out / "sessions.json", {"acq_time": meaning})
        write_json(out / "scans.json", {"acq_time": {"Description": "When the run began, UTC."}})
        people = write_participants(out, source, self._about, list(self._people.values()))
        described = describe(out, self._about, self._study)
        describe_derivatives(out / _DERIVATIVES, self._about, self._study)
        answered = self._phenotype.write(out)
        return (described, people, *answered, *(out / who for who in self._people), out / "sourcedata")

    def _keep_log(self, counted: Counted, folder: Path) -> None:
        """Copy the log itself, and the marks beside it, as they are."""
        target = self._out / folder
        target.mkdir(parents=True, exist_ok=True)
        path = counted.log.path
        logs = sorted(path.glob("*.mcap*")) if path.is_dir() else [path]
        for file in (*logs, marks_path(path)):
            if file.is_file():
                shutil.copyfile(file, target / file.name)

    def _draw(self, counted: Counted, name: str) -> None:
        if any(episode.start.map for episode in counted.episodes):
            save_png(session_paths(counted.session), self._out / _DERIVATIVES / "figures" / f"{name}_paths.png")

    def _count(self, episodes: tuple[Episode, ...]) -> None:
        self.sessions += 1
        self.episodes += len(episodes)
        self.steps += sum(len(episode.actions) for episode in episodes)
