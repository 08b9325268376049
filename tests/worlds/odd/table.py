"""All odd environments: importing this registers them."""

from tests.worlds.odd import actions, chance, failures, observations, pictures, values
from tests.worlds.odd.plain import ODD, OddEnvironment

__all__ = ["ODD", "OddEnvironment", "actions", "chance", "failures", "observations", "pictures", "values"]
