"""Replay: a session log in the rerun viewer, made from the log alone."""
