"""Reads a log file as events, or as a session of episodes."""
