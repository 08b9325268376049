"""The outcome rule of a block, and who stated it: the block, the catalogue, a table, or the world itself."""

from typing import Literal, NamedTuple

from minihuman.experiment.protocol.model import BlockSpec
from minihuman.worlds.adapters.outcome_table import find_table_entry
from minihuman.worlds.outcomes import (
    AT_ANY_STEP,
    INFO_PREFIX,
    LAST_REWARD,
    NO_RULE,
    OUTCOME_RULES,
    WORLD_RULE,
    add_any_step,
    normalize_outcome_rule,
    parse_outcome_rule,
)

HOW_TO_STATE_A_RULE = (
    'state one in the block, such as success = "info:is_success", "return >= 195", "terminated" or '
    '"terminated and reward > 0"'
)


class StatedRule(NamedTuple):
    """A block's outcome rule as its plan contains it, who stated it, why, and where it is documented."""

    rule: str
    stated_by: Literal["block", "catalogue", "table", "world", "study"]
    reason: str = ""
    source: str = ""

    @property
    def is_unknown(self) -> bool:
        """Return whether success can never be known under the rule."""
        return not parse_outcome_rule(self.rule).conditions

    def describe(self) -> str:
        """Return one line that describes the rule and who stated it."""
        words = describe_rule(self.rule)
        match self.stated_by:
            case "table":
                return f"{words} ({self.reason}: {self.source})"
            case "study":
                return f"{words}, as before: this study began when every world's last reward said so"
            case "world":
                return f"{words}; without that the outcome is 'ended' and success is empty"
            case _:
                return f"{words} (stated by the {self.stated_by})"


def describe_rule(rule: str) -> str:
    """Return an outcome rule in words, such as "success if terminated and reward > 0"."""
    text = rule.removesuffix(AT_ANY_STEP)
    suffix = rule[len(text) :]
    if text == NO_RULE:
        return "unknown: every end is 'ended', success is empty"
    if text == WORLD_RULE:
        return f"success where info['is_success'] or info['success'] says so{suffix}"
    if text == LAST_REWARD:
        return f"success if terminated and reward > 0{suffix}"
    return f"success if {text.replace(INFO_PREFIX, 'info: ')}{suffix}"


def find_outcome_rule(block: BlockSpec, *, outcome_rules: int = OUTCOME_RULES) -> StatedRule:
    """Return a block's outcome rule and who stated it.

    ``outcome_rules`` is the version of the rules that define outcomes: 0 in a study that began before there were any.

    Raises:
        ProtocolError: if the rule that the block states is not valid.
    """
    stated = _find_stated_rule(block, outcome_rules)
    if block.success is None and block.success_at == "any" and stated.stated_by != "study":
        return stated._replace(rule=add_any_step(stated.rule))
    return stated


def _find_stated_rule(block: BlockSpec, outcome_rules: int) -> StatedRule:
    """Return the rule that a block states, or else its world's rule, to which ``success_at`` is not applied yet."""
    if block.success is not None:
        rule = normalize_outcome_rule(block.success, at_any_step=block.success_at == "any")
        return StatedRule(rule, "block")
    if not outcome_rules and not is_of_catalogue(block.world):
        return StatedRule(LAST_REWARD, "study")
    return find_world_rule(block.world)


def find_world_rule(world_id: str) -> StatedRule:
    """Return the outcome rule that a world has in blocks that state no rule."""
    if is_of_catalogue(world_id):
        return StatedRule(LAST_REWARD, "catalogue")
    entry = find_table_entry(world_id)
    if entry is not None:
        return StatedRule(entry.rule, "table", entry.reason, entry.source)
    return StatedRule(WORLD_RULE, "world")


def is_of_catalogue(world_id: str) -> bool:
    """Return whether an id names a world of this package's catalogue."""
    module, _, name = world_id.rpartition(":")
    return module in ("", "minihuman") and name.startswith("minihuman/")
