"""Loads what processes of worlds need, once, in the process that forks them. Imported there alone.

That process ends with the program that started it, and not before: a service manager sends SIGTERM to all processes of
a service at once, and the worlds have to be there until the sessions are left.
"""

from minihuman.operating_system import ignore_termination
from minihuman.worlds.isolation import child

ignore_termination()

__all__ = ["child"]
