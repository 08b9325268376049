"""A scorecard: people, policies, models and simulated people on the same levels, as one table and one figure.

A level is a block's world with a seed. An episode is included if it ended by itself; an episode that a model's session
left unfinished is a failure. Scores do not require people, but the scorecard states who its reference is: people are
called human only if there are at least ten.
"""

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd

from minihuman.admin.next_session import find_remaining_episodes
from minihuman.dataset.selection import Selection
from minihuman.dataset.tables import Tables, select
from minihuman.errors import ReportError
from minihuman.experiment.machine.events import ModelCall
from minihuman.figures.figure_data import draw_figure_files
from minihuman.log.model.session_log import SessionLog
from minihuman.log.paths import MODELS_FOLDER
from minihuman.statistics.scores import DRAWS, HUMAN_REFERENCE, Estimate, PlayerScore, Runs, score_player

HUMAN = "human"
_COLUMNS = [
    *("participant", "session", "block", "episode", "attempt", "episode_in_block", "exclusion_reason", "world", "seed"),
    *("outcome", "success", "steps", "max_steps", "feasible_steps", "excess_steps", "spl"),
]
_SESSION = ["participant", "session"]
_QUESTION = ["questions", "item"]
_ANSWER = [*_SESSION, *_QUESTION, "kind", "number", "said"]
_ENDED = ("goal", "timeout", "failure")
UNFINISHED = "unfinished"
_LEVEL = ["block", "world", "seed"]
_MODELS = ("model:", "http:")  # players whose unfinished episodes are failures
_STAND_INS = ("human-like", "exploring", "optimal")  # stand-ins for people, the most similar first


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of a player's model calls; zeros for a player that is not a model."""

    calls: int = 0
    invalid: int = 0
    unknown: int = 0
    tokens: int = 0
    price: float = 0.0
    currency: str = ""
    declined: int = 0  # sessions in which it declined consent

    def add(self, further: "Costs") -> "Costs":
        """Return the sum of these and further costs; the currency is "mixed" if both have one and it differs."""
        currencies = {currency for currency in (self.currency, further.currency) if currency}
        currency = "mixed" if len(currencies) > 1 else "".join(currencies)
        sums = {}
        for cost_field in fields(Costs):
            name = cost_field.name
            sums[name] = getattr(self, name) + getattr(further, name)
        return Costs(**sums | {"currency": currency})


@dataclass(frozen=True, slots=True)
class ScoredPlayer:
    """One player's line of the scorecard."""

    player: str
    runs: int
    episodes: int
    levels: int  # shared with the reference
    unfinished: int  # episodes on shared levels left unfinished by a model's sessions; they are failures
    unknown_paths: int  # levels without a known shortest path; efficiencies exclude them
    score: PlayerScore
    excess_steps: float  # mean over successful episodes
    success_by_episode: tuple[float, ...]  # share of successes by episode number in the block
    costs: Costs


@dataclass(frozen=True, slots=True)
class Scorecard:
    """The scores of several players on the same levels."""

    reference: str  # "human (n = 12)", or a stand-in's name marked as such
    reference_player: str
    players: tuple[ScoredPlayer, ...]
    notes: tuple[str, ...]
    answers: pd.DataFrame  # a row per question and a column per player, without typed answers


@dataclass(frozen=True, slots=True, eq=False)
class PlayerRows:
    """The data of a study's players: included episodes, answers, and the costs of models."""

    source: Path
    episodes: pd.DataFrame
    answers: pd.DataFrame
    costs: Mapping[str, Costs]  # by player


def build_scorecard(
    studies: Sequence[Path],
    *,
    reference: str = "",
    selection: Selection | None = None,
    seed: int = 1,
    draws: int = DRAWS,
) -> Scorecard:
    """Score every player in some studies' folders and in the folders of their models.

    Args:
        studies: the studies' folders.
        reference: the player whose score is 1; by default people or, if there are none, the players most like them.
        selection: the rule that decides which episodes are included; None for the default selection.
        seed: the random seed of the bootstrap.
        draws: the number of bootstrap draws.

    Raises:
        ReportError: if there is no episode, the reference did not play, or no level is shared with it.
    """
    folders = [folder for study in studies for folder in (study, find_models_folder(study)) if folder.is_dir()]
    if not folders:
        raise ReportError(_describe_no_play(studies))
    plays = []
    for folder in dict.fromkeys(folders):
        with select(folder, selection) as tables:
            plays.append(read_player_rows(tables))
    return compose_scorecard(plays, reference=reference, seed=seed, draws=draws)


def compose_scorecard(
    plays: Sequence[PlayerRows], *, reference: str = "", seed: int = 1, draws: int = DRAWS
) -> Scorecard:
    """Score every player of some studies; the most efficient comes first, players without an efficiency last.

    Participants with the same code in one data folder count as one, so that a set of levels can comprise several
    protocols.

    Args:
        plays: the data of each study's players.
        reference: the player whose score is 1; by default people or, if there are none, the players most like them.
        seed: the random seed of the bootstrap.
        draws: the number of bootstrap draws.

    Raises:
        ReportError: if there is no episode, the reference did not play, or no level is shared with it.
    """
    rows = pd.concat([play.episodes for play in plays], ignore_index=True)
    answers = pd.concat([play.answers for play in plays], ignore_index=True)
    if not len(rows):
        raise ReportError(_describe_no_play([play.source for play in plays]))
    names = _name_players(rows["player"].unique())
    rows = rows.assign(player=rows["player"].map(names))
    rows["path_known"] = rows.groupby(_LEVEL)["feasible_steps"].transform("max").notna()
    costs = _sum_costs(plays, names)
    players = sorted(rows["player"].unique())
    reference_player = reference or next((name for name in (HUMAN, *_STAND_INS, *players) if name in players), "")
    if reference_player not in players:
        raise ReportError(f"reference {reference!r} played none of the levels; use one of {', '.join(players)}")
    scored = (_score_player(rows, name, reference_player, costs.get(name, Costs()), seed, draws) for name in players)
    lines = sorted(filter(None, scored), key=lambda line: -np.nan_to_num(line.score.efficiency.value, nan=-1.0))
    label = _label_reference(reference_player, rows.loc[rows["player"] == reference_player, "run"].nunique())
    return Scorecard(
        label,
        reference_player,
        tuple(lines),
        tuple(_list_notes(lines, reference_player, label, set(players))),
        _summarize_answers(answers.assign(player=answers["player"].map(names)).dropna(subset="player")),
    )


def _describe_no_play(studies: Sequence[Path]) -> str:
    return f"{', '.join(map(str, studies))}: no episode was played to its end; play some first"


def _sum_costs(plays: Iterable[PlayerRows], names: Mapping[str, str]) -> dict[str, Costs]:
    """Return the costs of each player's model calls, by the player's name on the scorecard."""
    costs: dict[str, Costs] = {}
    for play in plays:
        for player, price in play.costs.items():
            name = names.get(player, player)
            costs[name] = costs.get(name, Costs()).add(price)
    return costs


def _label_reference(reference: str, runs: int) -> str:
    """Return a label of the reference with its number of runs, stating if it stands in for people."""
    if reference != HUMAN:
        return f"{reference} (n = {runs}), in place of people"
    if runs < HUMAN_REFERENCE:
        return f"{runs} people, too few to be called human"
    return f"human (n = {runs})"


def find_models_folder(study: Path) -> Path:
    """Return the path of the folder with a study's models, whether or not it exists."""
    study = study.absolute()
    return study.parent / MODELS_FOLDER / study.name


def _summarize_answers(answers: pd.DataFrame) -> pd.DataFrame:
    """Summarize the last answers of each run: a row per question, a column per player, and texts as cells.

    A cell states the most frequent option of a choice, or the mean of numbers.
    """

    def summarize(group_answers: pd.DataFrame) -> str:
        option_counts = group_answers["said"].value_counts()
        has_options = group_answers["kind"].iloc[0].startswith("choice")
        if has_options:
            summary = f"{option_counts.index[0]}: {option_counts.iloc[0] / len(group_answers):.0%}"
        else:
            summary = f"{group_answers['number'].mean():.2f}"
        return f"{summary} (n = {len(group_answers)})"

    if not len(answers):
        return pd.DataFrame()
    last = answers.drop_duplicates(["run", *_QUESTION], keep="last").groupby([*_QUESTION, "player"])
    return last[["kind", "number", "said"]].apply(summarize).unstack(fill_value="")


def read_player_rows(tables: Tables) -> PlayerRows:
    """Read the included episodes without practice and the answers, each with its player, and the costs of models.

    The episodes that models left unfinished are added as failures.
    """
    columns = {"episodes": _COLUMNS, "participants": [*_SESSION, "player"], "answers": _ANSWER}
    tables.require((*columns, "model_calls"), shortest_paths=True)
    episodes, participants, answers = (tables.frame(name, names) for name, names in columns.items())
    players = participants.drop_duplicates(_SESSION)
    completed = episodes[episodes["exclusion_reason"].isna() & episodes["outcome"].isin(_ENDED)]
    numbers_and_options = answers[~answers["kind"].isin(("text", "long_text"))]
    logs = list(_read_model_logs(tables, participants))
    rows = pd.concat([completed.merge(players, on=_SESSION), pd.DataFrame(_list_unfinished(logs))], ignore_index=True)
    protocol = next((tables.read_protocol(session) for session in tables.sessions if session.study), None)
    if protocol:
        practice = {block.name for block in protocol.blocks if not block.analysed}
    else:
        practice = set()
    parent = f"{tables.source.parent}/"
    rows = rows.assign(run=parent + rows["participant"])
    answers = numbers_and_options.merge(players, on=_SESSION)
    return PlayerRows(
        tables.source,
        rows[~rows["block"].isin(practice)],
        answers.assign(run=parent + answers["participant"]),
        _count_costs(logs, protocol.model.currency if protocol else ""),
    )


def _read_model_logs(tables: Tables, participants: pd.DataFrame) -> Iterator[SessionLog]:
    """Read the logs of models' sessions, including those that are not selected, because their costs count too."""
    is_model = participants["player"].str.startswith(_MODELS)
    model_calls = tables.frame("model_calls", _SESSION)
    model_sessions = {*_list_sessions(participants[is_model]), *_list_sessions(model_calls)}
    for session in tables.sessions:
        if session.problem:
            continue
        outline = session.outline
        if outline is None or (outline.participant, outline.session) in model_sessions:
            yield tables.read_log(session)


def _list_sessions(rows: pd.DataFrame) -> Iterator[tuple[str, int]]:
    return zip(rows["participant"], rows["session"], strict=True)


def _count_costs(logs: Iterable[SessionLog], currency: str) -> dict[str, Costs]:
    """Return the costs of model calls, by player."""
    costs: dict[str, Costs] = {}
    for log in logs:
        calls = [event for event in log.part_events if isinstance(event, ModelCall) and event.state != "asked"]
        if calls:
            session_costs = Costs(
                calls=len(calls),
                invalid=sum(call.verdict == "invalid" for call in calls),
                unknown=sum(call.state == "unknown" for call in calls),
                tokens=sum(call.prompt_tokens + call.completion_tokens for call in calls),
                price=sum(call.price for call in calls),
                currency=currency,
                declined=int(log.end_reason == "declined"),
            )
            costs[log.player] = costs.get(log.player, Costs()).add(session_costs)
    return costs


def _list_unfinished(logs: Iterable[SessionLog]) -> Iterator[dict[str, object]]:
    """Yield a failure at the step limit for each episode that a model left unfinished, unless it declined consent."""
    for log in logs:
        if log.player.startswith(_MODELS) and log.end_reason != "declined":
            remaining = find_remaining_episodes(log)
            for plan in log.plan.episodes:
                if plan.episode not in remaining:
                    continue
                yield {
                    "participant": log.plan.participant.id,
                    "session": log.plan.session,
                    "player": log.player,
                    "block": plan.block_name,
                    "world": plan.world,
                    "seed": plan.seed,
                    "max_steps": plan.max_steps,
                    "episode_in_block": plan.episode_in_block + 1,
                    "steps": plan.max_steps,
                    "outcome": UNFINISHED,
                    "success": False,
                }


def _name_players(players: Iterable[str]) -> dict[str, str]:
    """Return each player's name on the scorecard, by player: for a policy, the file name if no other has the same."""
    names = {player: _shorten_player(player) for player in players}
    name_counts = Counter(names.values())
    ambiguous = {player: player for player, name in names.items() if name_counts[name] > 1}
    return names | ambiguous


def _shorten_player(player: str) -> str:
    """Remove the folder from the name of a policy."""
    if player.startswith("policy:") and "/" in player:
        return f"policy:{Path(player).name}"
    return player


def _score_player(
    rows: pd.DataFrame, name: str, reference: str, costs: Costs, seed: int, draws: int
) -> ScoredPlayer | None:
    """Score one player against the reference player; None if it shares no level with the reference.

    ``rows`` are the episodes of all players. ``seed`` and ``draws`` are of the bootstrap.
    """
    player_rows = rows[rows["player"] == name]
    reference_rows = rows[rows["player"] == reference]
    shared = player_rows[_LEVEL].drop_duplicates().merge(reference_rows[_LEVEL].drop_duplicates())
    if not len(shared):
        return None
    levels = pd.MultiIndex.from_frame(shared.sort_values(_LEVEL))
    runs = {player: _tabulate_runs(rows[rows["player"] == player], levels) for player in {name, reference, "random"}}
    random_runs = None
    if len(runs["random"].success):
        random_runs = runs["random"]
    return ScoredPlayer(
        player=name,
        runs=player_rows["run"].nunique(),
        episodes=len(player_rows),
        levels=len(levels),
        unfinished=int((player_rows.merge(shared)["outcome"] == UNFINISHED).sum()),
        unknown_paths=len(player_rows.loc[~player_rows["path_known"]].merge(shared)[_LEVEL].drop_duplicates()),
        score=score_player(runs[name], runs[reference], random_runs, seed=seed, draws=draws),
        excess_steps=float(player_rows["excess_steps"].mean()),
        success_by_episode=tuple(float(share) for share in player_rows.groupby("episode_in_block")["success"].mean()),
        costs=costs,
    )


def _tabulate_runs(rows: pd.DataFrame, levels: pd.MultiIndex) -> Runs:
    """Tabulate a player's success, SPL and steps by run and level; means if a run played a level several times.

    A failure has an SPL of 0 and as many steps as its limit. The SPL is NaN on levels without a known shortest path.
    """
    success = rows["success"].astype(float)
    spl = np.where(success > 0, rows["spl"], 0.0)
    values = rows.assign(
        success=success,
        spl=np.where(rows["path_known"], spl, np.nan),
        steps=np.where(success > 0, rows["steps"], rows["max_steps"]).astype(float),
    )
    means = values.groupby(["run", *_LEVEL])[["success", "spl", "steps"]].mean()
    return Runs(*(means[name].unstack(_LEVEL).reindex(columns=levels).to_numpy(float) for name in means))


def _list_notes(lines: Sequence[ScoredPlayer], reference: str, label: str, players: set[str]) -> Iterator[str]:
    """Yield the notes that are needed to interpret the scores.

    ``label`` describes the ``reference`` player; ``players`` also has those who share no level with the reference.
    """
    yield f"reference: {label}"
    if "random" not in players:
        yield "no random player: the human-normalised score's 0 is an efficiency of 0"
    for line in lines:
        if line.runs == 1:
            yield f"{line.player} has 1 run: its interval says nothing about other runs"
        if line.player != reference and not line.score.separable:
            runs = next(scored.runs for scored in lines if scored.player == reference)
            yield f"{runs} of {reference} on {line.levels} levels cannot separate {line.player} from them"
        if line.unfinished:
            share = f"{line.unfinished} of {line.runs * line.levels}"
            yield f"{line.player}: {share} levels not finished; they count as failures at the limit"
        if line.unknown_paths:
            yield f"{line.player}: {line.unknown_paths} levels have no known shortest path and are in no efficiency"
        if line.costs.declined:
            yield f"{line.player} declined to take part in {line.costs.declined} sessions"


def write_scorecard(card: Scorecard, out: Path, *, stem: str = "scores") -> tuple[Path, ...]:
    """Write the scores as CSV and Markdown, the answers (if any) as CSV, and the figure; return the paths."""
    out.mkdir(parents=True, exist_ok=True)
    page = out / f"{stem}.md"
    page.write_text(format_scorecard(card), encoding="utf-8", newline="\n")
    answer_files = []
    if len(card.answers):
        answer_files.append(out / f"{stem}_answers.csv")
        card.answers.to_csv(answer_files[0], lineterminator="\n")
    return (write_score_table(card, out / f"{stem}.csv"), page, *answer_files, *draw_scorecard(card, out / stem))


def write_score_table(card: Scorecard, path: Path) -> Path:
    """Write a line per player as CSV, with separate columns for the bounds of each interval; return the path."""
    lines = [_list_columns(line) for line in card.players]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, lines[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
    return path


def draw_scorecard(card: Scorecard, stem: Path) -> tuple[Path, Path]:
    """Draw scores with intervals, and success over a block's episodes; return the paths of the PNG and the PDF file."""
    bars = [(line.player, line.score, line.success_by_episode) for line in card.players]
    return draw_figure_files(stem, "estimation.score_figure", bars, reference=card.reference)


def format_scorecard(card: Scorecard) -> str:
    """Return the table of scores as Markdown, followed by the answers and by the notes that explain the scores."""
    heads = "player | runs | levels | success | efficiency | normalised | relative efficiency | excess steps | price"
    rows = [" | ".join(_list_cells(line)) for line in card.players]
    n_columns = heads.count("|") + 1
    table = [f"| {heads} |", "|---" * n_columns + "|", *(f"| {row} |" for row in rows)]
    if len(card.answers):
        table += ["", f"| question | {' | '.join(map(str, card.answers))} |", f"|---{'|---' * card.answers.shape[1]}|"]
        table += [f"| {'.'.join(name)} | {' | '.join(row)} |" for name, *row in card.answers.itertuples(name=None)]
    return "\n".join([*table, "", *(f"- {note}" for note in card.notes), ""])


def _list_cells(line: ScoredPlayer) -> list[str]:
    """Return the Markdown cells of a player's line."""
    score = line.score
    price = ""
    if line.costs.calls:
        price = f"{line.costs.price:.4f} {line.costs.currency}".strip()
    return [
        line.player,
        str(line.runs),
        str(line.levels),
        *map(_format_estimate, (score.success, score.efficiency, score.normalised, score.relative_efficiency)),
        _format_steps(line.excess_steps),
        price,
    ]


def _format_estimate(estimate: Estimate) -> str:
    if np.isnan(estimate.value):
        return ""
    return f"{estimate.value:.2f} [{estimate.low:.2f}, {estimate.high:.2f}]"


def _format_steps(steps: float) -> str:
    if np.isnan(steps):
        return ""
    return f"{steps:.1f}"


def _list_columns(line: ScoredPlayer) -> Mapping[str, object]:
    """Return the cells of a player's CSV line by column name."""
    score = line.score
    costs = line.costs
    estimates_by_name = {
        "success": score.success,
        "efficiency": score.efficiency,
        "normalised_score": score.normalised,
        "relative_efficiency": score.relative_efficiency,
        "success_difference": score.difference,
    }
    estimate_cells: dict[str, str] = {}
    for name, estimate in estimates_by_name.items():
        estimate_cells[name] = f"{estimate.value:.6g}"
        estimate_cells[f"{name}_low"] = f"{estimate.low:.6g}"
        estimate_cells[f"{name}_high"] = f"{estimate.high:.6g}"
    return {
        "player": line.player,
        "runs": line.runs,
        "episodes": line.episodes,
        "levels": line.levels,
        "unfinished": line.unfinished,
        **estimate_cells,
        "excess_steps": _format_steps(line.excess_steps),
        "separable": score.separable,
        "success_by_episode": " ".join(f"{share:.4g}" for share in line.success_by_episode),
        "calls": costs.calls,
        "invalid_answers": costs.invalid,
        "unknown_calls": costs.unknown,
        "tokens": costs.tokens,
        "price": f"{costs.price:.6g}",
        "currency": costs.currency,
        "declined": costs.declined,
    }
