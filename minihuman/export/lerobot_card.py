"""The card of a LeRobot dataset: a README whose front matter the Hub reads."""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from minihuman import __version__
from minihuman.study.about import About

_TASKS_SHOWN = 20


def card(about: About, world: str, info: Mapping[str, Any], tasks: Sequence[str]) -> str:
    """The text; what the protocol does not say is not in it."""
    front: dict[str, Any] = {
        "license": about.licence.lower() if about.licence and "://" not in about.licence else "unknown",
        "task_categories": ["robotics"],
        "tags": ["LeRobot", "minihuman", *about.keywords],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    if about.title:
        front["pretty_name"] = about.title
    lines = ["---", *_yaml(front), "---", "", f"# {about.title or world}", ""]
    lines += [about.description, ""] if about.description else []
    lines += [
        f"{info['total_episodes']} episodes, {info['total_frames']} frames of `{world}`.",
        f"Written by minihuman {__version__} in LeRobot's format {info['codebase_version']}.",
        "",
        "- `action` has a 1 at its place among the names; `action_index` is what the environment's step takes.",
        "- `timestamp` is frame number over a nominal frame rate; people took as long as they took, see `time_s`.",
        "- `minihuman/...` in `meta/episodes` says who played, in which session, episode and attempt, with which keys.",
    ]
    if "observation.image" in info["features"]:
        lines.append("- `observation.state` is where the agent stood, which people saw only in the picture.")
    lines += ["", "Tasks:", "", *(f"- {task}" for task in tasks[:_TASKS_SHOWN])]
    lines += [f"- and {len(tasks) - _TASKS_SHOWN} more"] if len(tasks) > _TASKS_SHOWN else []
    for name, values in (
        ("Authors", [f"{author.name} {author.orcid}".strip() for author in about.authors]),
        ("Funding", about.funding),
        ("Cite", [f"https://doi.org/{about.doi}"] if about.doi else []),
        ("References", about.references),
    ):
        lines += ["", f"{name}: {'; '.join(values)}"] if values else []
    return "\n".join(lines) + "\n"


def _yaml(front: Mapping[str, Any]) -> list[str]:
    """Front matter: JSON is YAML, a key a line."""
    return [f"{name}: {msgspec.json.encode(value).decode()}" for name, value in front.items()]
