"""What every odd environment is held to: refused in a sentence that names the cause, or played, proven and exported."""

import re
from contextlib import closing
from pathlib import Path

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.selection import Selection
from minihuman.errors import ExportError, MinihumanError, ProtocolError
from minihuman.experiment.keys import DIGITS
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.exporters.exporter import export_study, list_exporters
from minihuman.runtime.simulated_session import simulate
from minihuman.testing.checks import build_study
from minihuman.worlds.adapters.world import World
from tests.worlds.odd.plain import OddEnvironment

EPISODES = 2
OF_TEAMS = ("overcooked", "pettingzoo")  # what these hold no odd environment is
PYTHON_WORDS = ("Traceback", "object has no attribute", "not subscriptable", "0-dimensional", "NoneType")


def build_odd_study(environment: OddEnvironment) -> Protocol:
    """A study of two episodes, whose keys do the first of the environment's actions that can be named."""
    try:
        with closing(World(environment.id)) as world:
            actions = tuple(dict.fromkeys(world.action_names))[: len(DIGITS)]
            actions = actions if world.actions.is_discrete else actions[:-1]
    except MinihumanError:
        actions = ("0",)
    block = {"name": "block", "world": environment.id, "episodes": EPISODES, "actions": actions, "max_steps": 20}
    return build_study(
        {
            "study": {"name": "odd", "version": "1", "seed": 5, "participants": 2},
            "keys": {"pool": DIGITS[: max(3, len(actions))]},
            "groups": [{"name": "everyone", "blocks": ["block"]}],
            "blocks": [block],
        }
    )


def hold_to_contract(environment: OddEnvironment, folder: Path) -> str:
    """Hold an environment to the contract; says what became of it, for a table.

    Raises:
        AssertionError: if it is not kept.
    """
    protocol = build_odd_study(environment)
    try:
        notices = check_worlds(protocol, "odd.toml", provable=True)
    except ProtocolError as error:
        require_sentence(error, environment.refused)
        return f"refused: {error}"
    assert not environment.refused, f"{environment.name} is not refused; {notices}"
    if environment.noticed:
        assert any(re.search(environment.noticed, notice) for notice in notices), (environment.name, notices)
    require_proven(protocol, folder)
    refusals = export_everything(folder / "odd", folder)
    for refusal in refusals.values():
        require_sentence(refusal, environment.unexportable)
    if environment.unexportable:
        assert refusals, f"every exporter took {environment.name}"
    return f"played; notices {notices}; exports refused: { {name: str(error) for name, error in refusals.items()} }"


def require_proven(protocol: Protocol, data: Path) -> None:
    """Play a session, which has as many episodes as it should, and prove it."""
    logs = list(simulate(protocol, data, participants=1, seed=1, player="random"))
    assert len(logs) == 1
    lines = list(verify_session(logs[0]))
    assert all(right for _, right in lines), lines
    assert any(f"{EPISODES} episodes" in line for line, _ in lines), lines


def export_everything(study: Path, folder: Path) -> dict[str, MinihumanError]:
    """Export a study in every format; what some of them refuse, and then nothing is written."""
    refusals: dict[str, MinihumanError] = {}
    for name in list_exporters():
        if name in OF_TEAMS:
            continue
        out = folder / f"as-{name}"
        try:
            export_study(name, study, out, Selection())
        except ExportError as error:
            refusals[name] = error
            assert not out.exists()
    return refusals


def require_sentence(error: MinihumanError, cause: str) -> None:
    """One line, in words of ours, that names the cause."""
    said = str(error)
    assert cause, f"not expected: {said}"
    assert re.search(cause, said), f"{said!r} does not name {cause!r}"
    assert "\n" not in said
    assert not any(words in said for words in PYTHON_WORDS), said
