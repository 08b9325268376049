"""A protocol's versions: told apart by what a protocol calls itself, and by its bytes."""

from minihuman.study.plan import SessionPlan

_ENOUGH = 6  # letters of a SHA-256 that name a protocol


def version_name(plan: SessionPlan) -> str:
    """The version of the protocol a session was played by, told apart from another of that name: "1 (d3b07384)"."""
    return f"{plan.study_version} ({plan.protocol_sha256[:8]})"


def is_version(plan: SessionPlan, asked: str) -> bool:
    """Whether a session was played by a version: by its own name, as above, or by the start of its SHA-256."""
    by_hash = len(asked) >= _ENOUGH and plan.protocol_sha256.startswith(asked)
    return by_hash or asked in (plan.study_version, version_name(plan))
