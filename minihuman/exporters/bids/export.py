"""Export a study as a BIDS dataset.

The dataset has a description, the participants, the runs of every session, the source logs, and derived tables and
figures.
"""

import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minihuman import __version__
from minihuman.dataset.annotations import annotations_path
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.participants_file import read_participants_file
from minihuman.dataset.selection import SelectedSession
from minihuman.dataset.study_facts import read_study_facts
from minihuman.dataset.tables import select
from minihuman.errors import ExportError
from minihuman.experiment.machine.events import ActivityEvent
from minihuman.experiment.protocol.about_spec import name_person_column
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.bids.events import (
    EVENT_COLUMNS,
    build_events,
    describe_event_columns,
    describe_label_columns,
)
from minihuman.exporters.bids.files import (
    Phenotype,
    make_label,
    make_subject_label,
    write_json,
    write_motion,
    write_physio,
    write_tsv,
)
from minihuman.exporters.bids.stimulus_files import STIM_FILE, STIM_FILE_COLUMN, SessionStimuli, StimulusFiles
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.reading import GUARD_LINES
from minihuman.exporters.study_metadata import get_plan_devices
from minihuman.figures.path_figures import session_paths
from minihuman.figures.style import save_png
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.log.paths import list_log_files

BIDS_VERSION = "1.11.0"
HED_VERSION = "8.3.0"
GENERATED_BY = {"Name": "minihuman", "Version": __version__}


def write_participants(out: Path, source: Path, study_facts: AboutSpec, people: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``participants.tsv`` and the meaning of its columns; the laboratory's own columns follow the built-in ones.

    Args:
        out: the folder of the dataset.
        source: the study's folder, which may have a `participants.csv`, or a log.
        study_facts: the facts about the study.
        people: a row per participant, with ``code`` and the built-in columns.

    Returns:
        The path of ``participants.tsv``.

    Raises:
        ParticipantsFileError: as for ``read_participants_file``.
    """
    cells_by_code = read_participants_file(source, study_facts.participant_columns).rows
    rows = []
    for person in people:
        cells = cells_by_code.get(person["code"], {})
        rows.append({**person, **{name_person_column(name): cell for name, cell in cells.items()}})
    described: dict[str, Any] = {
        "group": {"Description": "The group that the participant was allocated to."},
        "player": {"Description": "Whoever pressed the keys: human, or a simulated player's name."},
    }
    for column in study_facts.participant_columns:
        meaning: dict[str, Any] = {"Description": column.description}
        if column.unit:
            meaning["Units"] = column.unit
        if column.levels:
            meaning["Levels"] = column.levels
        described[name_person_column(column.name)] = meaning
    write_json(out / "participants.json", described)
    return write_tsv(out / "participants.tsv", ["participant_id", *described], rows)


_DERIVATIVES = Path("derivatives/minihuman")


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every selected session as a BIDS dataset, with a run for each segment of a session.

    Raises:
        ExportError: if the dataset would mix two studies, or if two participants would have the same label.
        ParticipantsFileError: if the laboratory's table of participants does not match the protocol.
    """
    dataset: _Dataset | None = None
    for session in chosen.counted():
        dataset = dataset or _Dataset(out, session, with_messages=chosen.with_messages)
        dataset.add(session)
    if dataset is None:
        return ExportResult((), 0, 0)
    with select(chosen.sessions.source, chosen.sessions.selection) as tables:  # the first pass gave the card's account
        tables.write(out / _DERIVATIVES / "tables", kinds=("csv",), without=COLUMNS_NEEDING_WORLD)
    paths = dataset.finish(chosen.sessions.source)
    return ExportResult(
        (*paths, out / _DERIVATIVES),
        dataset.episodes,
        dataset.steps,
        left_out=dataset.describe_excluded_logs(),
        reading=GUARD_LINES,
        sessions=dataset.sessions,
    )


def _holds_messages(log: SessionLog) -> bool:
    """Return whether a log contains messages that its participant wrote to others."""
    return any(isinstance(event, ActivityEvent) and event.words_to_others for event in log.part_events)


def _format_bids_time(timestamp: str) -> str:
    """Format an ISO time in UTC as BIDS requires: without a time zone, and with six decimals at most."""
    return timestamp.removesuffix("Z")[: len("2026-01-31T12:00:00.000000")]


class _Dataset:
    """A BIDS dataset that is being written."""

    def __init__(self, out: Path, first: SelectedSession, *, with_messages: bool) -> None:
        plan = first.log.plan
        self.episodes = self.steps = self.sessions = 0
        self._with_messages = with_messages
        self._excluded_logs = 0
        self._out = out
        self._study = plan.study
        self._study_facts: AboutSpec = read_study_facts(first.log.path, plan.protocol_toml)
        self._task = make_label(plan.study)
        facts = {  # what every recording's sidecar says of the task and the place
            "TaskName": self._study_facts.title or plan.study,
            "TaskDescription": self._study_facts.task_description or self._study_facts.description,
            "InstitutionName": self._study_facts.institution,
            "InstitutionAddress": self._study_facts.address,
            "InstitutionalDepartmentName": self._study_facts.department,
        }
        self._task_facts = {name: value for name, value in facts.items() if value}
        self._labels: dict[str, str] = {}
        self._people: dict[str, dict[str, Any]] = {}
        self._sessions: defaultdict[str, list[dict[str, str]]] = defaultdict(list)
        self._phenotype = Phenotype()
        self._further_columns: dict[str, Any] = {}
        self._stimulus_files = StimulusFiles(out)
        self._station = first.log.facts

    def add(self, selected: SelectedSession) -> None:
        """Write the files of one session: events, motion, devices' samples, the source log and a figure."""
        log = selected.log
        out = self._out
        if log.plan.study != self._study:
            raise ExportError(
                f"{log.path} is from study {log.plan.study!r}, the other logs from {self._study!r}; export one study "
                "at a time"
            )
        subject = make_subject_label(log.plan.participant.id, self._labels)
        session = f"ses-{log.plan.session:02d}"
        stem = f"{subject}_{session}_task-{self._task}"
        folder = out / subject / session
        counting = frozenset((episode.number, episode.attempt) for episode in selected.episodes)
        episodes = [episode for episode, is_asked in zip(log.episodes, selected.selected, strict=True) if is_asked]
        devices = get_plan_devices(log.plan)
        stimuli = SessionStimuli(log, self._stimulus_files)
        scans: list[dict[str, str]] = []
        for segment in log.segments:
            run_episodes = [episode for episode in episodes if episode.segment == segment.number]
            rows = build_events(segment, run_episodes, counting, stimuli)
            recordings = [self._write_events(folder / "beh", stem, segment.number, run_episodes, rows)]
            recordings += write_motion(stem, folder / "motion", segment.number, self._task_facts, segment, run_episodes)
            recordings += write_physio(stem, folder / "beh", segment.number, self._task_facts, segment, devices)
            acquired_at = _format_bids_time(segment.started_at)
            scans += [{"filename": str(path.relative_to(folder)), "acq_time": acquired_at} for path in recordings]
        write_tsv(folder / f"{subject}_{session}_scans.tsv", ["filename", "acq_time"], scans)
        self._copy_log(selected, Path("sourcedata") / subject / session)
        self._draw_paths(selected, f"{subject}_{session}")
        self._phenotype.add(log, subject, session)
        self._sessions[subject].append({"session_id": session, "acq_time": _format_bids_time(log.started_at)})
        self._people.setdefault(
            subject,
            {
                "participant_id": subject,
                "code": log.plan.participant.id,
                "group": log.plan.participant.group,
                "player": log.player,
            },
        )
        self._count_session(selected.episodes)

    def _write_events(
        self, folder: Path, stem: str, run: int, episodes: Sequence[EpisodeLog], rows: Sequence[Mapping[str, Any]]
    ) -> Path:
        """Write a run's events, with columns of labels and of stimuli's files if there are any; return the file.

        The description of these further columns is kept for the dataset's sidecar.

        Args:
            folder: the folder of the file.
            stem: the subject, session and task, with which the file's name begins.
            run: the number of the run.
            episodes: the run's episodes, whose labels become columns.
            rows: the events.
        """
        more_columns = describe_label_columns(episodes)
        if any(STIM_FILE in row for row in rows):
            more_columns |= STIM_FILE_COLUMN
        self._further_columns |= more_columns
        return write_tsv(folder / f"{stem}_run-{run}_events.tsv", [*EVENT_COLUMNS, *more_columns], rows)

    def describe_excluded_logs(self) -> tuple[str, ...]:
        """Return a line with the number of logs missing from the dataset and the reason; none if no log is missing."""
        if not self._excluded_logs:
            return ()
        line = (
            f"{self._excluded_logs} logs with messages between participants are not in sourcedata, as a log cannot be "
            "edited; export again with --with-messages if the participants agreed to publish what they wrote"
        )
        return (line,)

    def finish(self, source: Path) -> tuple[Path, ...]:
        """Write the files that describe the whole dataset; return the paths of the dataset's files and folders.

        ``source`` is the exported study's folder, which may have a `participants.csv`, or a log.
        """
        out = self._out
        stimuli = {
            "SoftwareName": "minihuman",
            "SoftwareVersion": self._station.get("version_minihuman", __version__),
            "OperatingSystem": self._station.get("system", ""),
        }
        presented = {"StimulusPresentation": {name: fact for name, fact in stimuli.items() if fact}}
        write_json(
            out / f"task-{self._task}_events.json",
            self._task_facts | presented | describe_event_columns() | self._further_columns,
        )
        for subject, sessions in self._sessions.items():
            write_tsv(out / subject / f"{subject}_sessions.tsv", ["session_id", "acq_time"], sessions)
        meaning = {"Description": "When the session began, UTC."}
        write_json(out / "sessions.json", {"acq_time": meaning})
        write_json(out / "scans.json", {"acq_time": {"Description": "When the run began, UTC."}})
        participants_path = write_participants(out, source, self._study_facts, list(self._people.values()))
        description_path = write_json(out / "dataset_description.json", self._describe())
        write_json(
            out / _DERIVATIVES / "dataset_description.json",
            {
                "Name": f"{self._study_facts.title or self._study}: tables and figures",
                "BIDSVersion": BIDS_VERSION,
                "DatasetType": "derivative",
                "GeneratedBy": [GENERATED_BY],
                "License": self._study_facts.licence,
            },
        )
        phenotype_folders = self._phenotype.write(out)
        subject_folders = [out / subject for subject in self._people]
        return (description_path, participants_path, *phenotype_folders, *subject_folders, out / "sourcedata")

    def _describe(self) -> dict[str, Any]:
        """Return the contents of ``dataset_description.json``, taken from the protocol's facts about the study."""
        facts = self._study_facts
        return {
            "Name": facts.title or self._study,
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "HEDVersion": HED_VERSION,
            "License": facts.licence,
            "Authors": [author.name for author in facts.authors],
            "Keywords": list(facts.keywords),
            "HowToAcknowledge": facts.how_to_acknowledge,
            "Funding": list(facts.funding),
            "EthicsApprovals": list(facts.ethics_approvals),
            "ReferencesAndLinks": list(facts.references),
            "DatasetDOI": f"doi:{facts.doi}" if facts.doi else "",
            "GeneratedBy": [GENERATED_BY],
        }

    def _copy_log(self, session: SelectedSession, folder: Path) -> None:
        """Copy a session's log and annotations unchanged into ``folder``, a path inside the dataset.

        A log with messages to other participants is copied only if the export is to have messages.
        """
        target = self._out / folder
        target.mkdir(parents=True, exist_ok=True)
        path = session.log.path
        logs = [path]
        if path.is_dir():
            logs = list_log_files(path, "*.mcap*")
        if not self._with_messages and _holds_messages(session.log):
            logs = []
            self._excluded_logs += 1
        for file in (*logs, annotations_path(path)):
            if file.is_file():
                shutil.copyfile(file, target / file.name)

    def _draw_paths(self, session: SelectedSession, name: str) -> None:
        """Write a figure of the session's paths, if a world of it has a map; the file's name begins with ``name``."""
        if any(episode.start.map for episode in session.episodes):
            save_png(session_paths(session.session), self._out / _DERIVATIVES / "figures" / f"{name}_paths.png")

    def _count_session(self, episodes: tuple[EpisodeLog, ...]) -> None:
        """Add a session to the export's counts."""
        self.sessions += 1
        self.episodes += len(episodes)
        self.steps += sum(len(episode.actions) for episode in episodes)
