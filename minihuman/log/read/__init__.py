"""Read a log file back to events, or to a session of episodes."""
