"""Replays a session log in the rerun viewer, from the log alone."""
