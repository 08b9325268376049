"""The transfer study as values: its settings, its cells, and one job for every cell and run. Nothing runs here."""

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

from minihuman.errors import LearnError
from minihuman.learn.ppo import PpoSettings
from minihuman.worlds.first_person.rules import ACTIONS
from minihuman.worlds.hashing import hash64

ProtocolName = Literal["as-intended", "as-published", "as-published-2023-05-28"]
PROTOCOLS: tuple[ProtocolName, ...] = get_args(ProtocolName)
# The states of BolunDai0216/MinigridMiniworldTransfer that are reproduced: what the paper links to, and what stood
# there until 6 June 2023. They differ in the critic's head and in the divisor of an improvement.
COMMITS: dict[ProtocolName, str] = {"as-published": "5991820", "as-published-2023-05-28": "bb21269"}

GRID_WORLD = "minihuman/MiniGrid-GoToObj-Transfer-v0"
FIRST_PERSON_WORLD = "minihuman/MiniWorld-GoToObj-Transfer-v0"
SOURCE = "source"
BASELINE = "baseline"
TRANSFERS = ("M", "A", "C", "AM", "CM", "ACM")
SOURCE_STEPS: dict[ProtocolName, int] = {
    "as-intended": 500_000,
    "as-published": 2_000_000,
    "as-published-2023-05-28": 2_000_000,
}
QUICK_STEPS = 2_048

# What the published code does, beside what its table says. Every output of these protocols names them.
_DEFECTS = (
    (
        "transferred layers replace their parameters after the optimiser was built, so they never move, frozen or "
        "not; where not frozen their gradients pile up and shrink everyone's share of the clipped norm"
    ),
    (
        "the source's actor head has seven outputs in a world of three actions; the other four move back, pick up, "
        "drop and toggle there"
    ),
    "the frozen CM row misspells M's freeze flag and leaves M free",
    "one source checkpoint serves all runs",
    "the grid draws colours with repetition, so some missions match two objects; the 3D world draws them without",
    "grid codes from 0 to 10 are scaled as if they were colours from 0 to 255",
)
DEFECTS: dict[ProtocolName, tuple[str, ...]] = {
    "as-intended": (),
    "as-published": _DEFECTS,
    "as-published-2023-05-28": (
        *_DEFECTS,
        "the critic's head: its weight is frozen in every C row, its bias is transferred in the frozen C rows only",
        "improvements are divided by the area of one baseline run, as if it were known exactly (here by their mean)",
    ),
}


@dataclass(frozen=True, slots=True)
class TransferStudy:
    """Everything that decides the study's numbers."""

    protocol: ProtocolName = "as-intended"
    runs: int = 5  # of the source and of each transfer
    baselines: int = 10  # every comparison has the baseline in it, so its runs are worth most
    steps: int = 200_000  # of the baseline and of each transfer
    source_steps: int | None = None  # None: the protocol's own
    seed: int = 1
    quick: bool = False  # far fewer steps, said in every output
    transfers: tuple[str, ...] = TRANSFERS
    ppo: PpoSettings = field(default_factory=PpoSettings)

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        if self.protocol not in PROTOCOLS:
            raise LearnError(f"protocol is {self.protocol!r}; it is one of {', '.join(PROTOCOLS)}")
        for name in ("runs", "baselines", "steps"):
            if getattr(self, name) < 1:
                raise LearnError(f"{name} is {getattr(self, name)}; it is 1 or more")
        if self.source_steps is not None and self.source_steps < 1:
            raise LearnError(f"source steps are {self.source_steps}; they are 1 or more")
        if unknown := [name for name in self.transfers if name not in TRANSFERS]:
            raise LearnError(f"no transfer is called {unknown[0]!r}; there are {', '.join(TRANSFERS)}")

    @property
    def cells(self) -> tuple["TransferCell", ...]:
        """Source, baseline, and every transfer free and frozen, in the order of the published table."""
        transfers = [TransferCell(name, frozen) for name in self.transfers for frozen in (False, True)]
        return (TransferCell(SOURCE), TransferCell(BASELINE), *transfers)

    @property
    def published(self) -> bool:
        """Whether this is a state of the published code."""
        return self.protocol != "as-intended"

    def runs_of(self, cell: "TransferCell") -> int:
        """How many runs a cell has: the published study trained one source only."""
        if cell.name == SOURCE and self.published:
            return 1
        return self.baselines if cell.name == BASELINE else self.runs

    def jobs(self, first_run: int = 0) -> tuple["TransferJob", ...]:
        """One job for every cell and run, run by run, so that a whole table exists after each; sources first.

        From ``first_run`` on, and the one source of all runs where there is only one.
        """
        return tuple(
            TransferJob(self, cell, run)
            for run in range(max(self.runs, self.baselines))
            for cell in self.cells
            if run < self.runs_of(cell) and (run >= first_run or self.runs_of(cell) == 1)
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class TransferCell:
    """One row of the table: what is transferred, and whether it stays frozen."""

    name: str  # "source", "baseline", or the letters of what moves
    frozen: bool = False

    @property
    def parts(self) -> frozenset[str]:
        """The letters of what moves: M mission, A actor, C critic."""
        return frozenset() if self.name in (SOURCE, BASELINE) else frozenset(self.name)

    @property
    def label(self) -> str:
        """How tables and folders call it: "CM-frozen"."""
        return f"{self.name}-frozen" if self.frozen else self.name


@dataclass(frozen=True, slots=True)
class TransferJob:
    """One cell, one run: independent, seeded, resumable."""

    study: TransferStudy
    cell: TransferCell
    run: int

    @property
    def name(self) -> str:
        """Its folder below the study's: "CM-frozen/run-02"."""
        return f"{self.cell.label}/run-{self.run:02d}"

    @property
    def source(self) -> "TransferJob | None":
        """The job whose weights it needs; None where it starts from nothing."""
        if not self.cell.parts:
            return None
        return TransferJob(self.study, TransferCell(SOURCE), 0 if self.study.published else self.run)

    @property
    def world(self) -> str:
        """The Gymnasium id it trains in."""
        return GRID_WORLD if self.cell.name == SOURCE else FIRST_PERSON_WORLD

    @property
    def world_options(self) -> dict[str, Any]:
        """Keyword arguments of ``gymnasium.make``: the published worlds, defects included, or ours."""
        if not self.study.published:
            return {}
        return {"ambiguous": True} if self.cell.name == SOURCE else {"actions": ACTIONS[:7]}

    @property
    def actions(self) -> int:
        """How many actions the policy chooses among (the published one was told 3 in the 3D world)."""
        return 7 if self.cell.name == SOURCE else 3

    @property
    def steps(self) -> int:
        """How long it trains; whole updates, so the last may run over."""
        if self.cell.name != SOURCE:
            return self.study.steps
        return self.study.source_steps or SOURCE_STEPS[self.study.protocol]

    @property
    def seed(self) -> int:
        """Of first weights, layouts and draws. A run's transfers share its baseline's, so that they differ in less."""
        return hash64((self.study.seed, SOURCE if self.cell.name == SOURCE else "target", self.run)) % 2**31

    @property
    def config(self) -> dict[str, Any]:
        """Everything that decides this job's result, the source's result included."""
        source = self.source
        return {
            "protocol": self.study.protocol,
            "cell": self.cell.label,
            "run": self.run,
            "seed": self.seed,
            "world": self.world,
            "world_options": self.world_options,
            "steps": self.steps,
            "ppo": asdict(self.study.ppo),
            "source": None if source is None else source.config_hash,
        }

    @property
    def config_hash(self) -> str:
        """A short name for the configuration."""
        return f"{hash64(self.config):016x}"


def make_quick_study(study: TransferStudy) -> TransferStudy:
    """The same study with far fewer steps: it shows that everything runs, its numbers mean nothing."""
    return replace(study, quick=True, steps=QUICK_STEPS, source_steps=QUICK_STEPS)
