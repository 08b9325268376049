"""Small studies recorded by simulated participants, logs on disk and all."""

from pathlib import Path

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate

DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"


def recorded(folder: Path, *, participants: int, player: str = "optimal", toml: bytes | None = None) -> Path:
    """The folder of a study played to its end; the demo's four episodes unless another protocol is given."""
    protocol = decode_protocol(toml or DEMO.read_bytes())
    list(simulate(protocol, folder, participants=participants, seed=3, player=player))
    return folder / protocol.study.name
