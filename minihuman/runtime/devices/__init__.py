"""Devices besides the keyboard: their samples go into the session's log, and markers go out to other recorders."""
