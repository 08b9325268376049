"""Writes the folder from which a study is served: container file, compose file, Caddyfile, systemd unit.

Nothing here starts a server. The files are rendered from the Jinja templates beside this module.
"""

import secrets
import stat
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from urllib.parse import urlsplit

from jinja2 import Environment, StrictUndefined

from minihuman.admin.policies import POLICY_SUFFIX
from minihuman.errors import ProtocolError
from minihuman.experiment.protocol.protocol import Protocol

FILE_NAMES = ("Containerfile", "compose.yaml", "Caddyfile", "minihuman.service", "README.md")
SECRETS_FILE_NAME = ".env"


@dataclass(frozen=True, slots=True)
class Deployment:
    """The settings with which a study is served.

    Args:
        address: the public base URL, with https.
        workers: the number of server processes; Caddy routes each participant to one of them.
        postgres: whether the enrolment log and the arrivals are kept in a PostgreSQL database of the deployment.
        bucket: the destination of finished logs, such as "s3://bucket/prefix"; "" keeps them on the machine.

    Raises:
        ProtocolError: if the address or the bucket is not valid.
    """

    address: str
    workers: int = 1
    postgres: bool = False
    bucket: str = ""

    def __post_init__(self) -> None:
        url = urlsplit(self.address)
        if url.scheme != "https" or not url.hostname or url.path.strip("/") or url.port is not None:
            raise ProtocolError(
                f"--address {self.address!r} is not valid; use https:// and a host, as in https://study.example.org"
            )
        if self.bucket and not self.bucket.startswith("s3://"):
            raise ProtocolError(f"--bucket {self.bucket!r} is not valid; use s3:// and a bucket, as in s3://logs/study")


def write_deployment(protocol: Protocol, out: Path, deployment: Deployment) -> list[Path]:
    """Write the folder from which a study is served. Existing passwords are kept; all other files are overwritten.

    Returns:
        The paths of the folder's files.

    Raises:
        OSError: if a file cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    contents = _render_files(protocol, deployment)
    for name, content in contents.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(content)
    paths = [out / name for name in contents]
    if deployment.postgres:
        secrets_file = out / SECRETS_FILE_NAME
        if not secrets_file.exists():
            secrets_file.touch(mode=stat.S_IRUSR | stat.S_IWUSR)  # before the password is in it
            secrets_file.write_text(f"POSTGRES_PASSWORD={secrets.token_urlsafe(24)}\n", encoding="ascii", newline="\n")
        paths.append(secrets_file)
    return paths


def _render_files(protocol: Protocol, deployment: Deployment) -> dict[str, bytes]:
    """Return the contents of the folder's files by name, without the file of passwords."""
    agents = [block.agent for block in protocol.blocks if block.agent is not None]
    needs_extra = {
        "web": True,
        "postgres": deployment.postgres,
        "s3": bool(deployment.bucket),
        "learn": any(agent.learner or agent.policy.endswith(POLICY_SUFFIX) for agent in agents),
    }
    jinja = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    contents = {"study.toml": protocol.toml, **protocol.files}
    study_files = sorted(contents)
    for name in FILE_NAMES:
        template = files(__package__).joinpath("templates", f"{name}.j2").read_text(encoding="utf-8")
        text = jinja.from_string(template).render(
            deployment=deployment,
            host=urlsplit(deployment.address).hostname,
            study=protocol.study.name,
            extras=",".join(name for name in needs_extra if needs_extra[name]),
            files=study_files,
        )
        contents[name] = text.encode()
    if deployment.postgres:
        contents["register.url"] = b"postgresql://minihuman@postgres/studies\n"
    if deployment.bucket:
        contents["logs.url"] = f"{deployment.bucket}\n".encode()
    return contents
