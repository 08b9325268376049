"""minihuman: run people and agents through reinforcement-learning worlds, and keep everything.

Importing it registers our worlds with Gymnasium under ``minihuman/<name>``.
"""

from minihuman.worlds.catalogue import register as _register

__version__ = "0.1.0"

_register()
