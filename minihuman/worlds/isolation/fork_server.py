"""Preloads the modules that world processes need, once, in the server process from which they are forked.

Only that process imports this module. The process ignores SIGTERM and ends with the program that started it: a service
manager sends SIGTERM to all processes of a service at once, and worlds must run until their sessions are over.
"""

from minihuman.operating_system import ignore_termination
from minihuman.worlds.isolation import child

ignore_termination()

__all__ = ["child"]
