"""Devices beside the keyboard: their samples into the session's log, and markers out to other recorders."""
