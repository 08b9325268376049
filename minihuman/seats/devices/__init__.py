"""Devices beside the keyboard: samples into the session's log, and its markers out to other recorders."""
