"""Records events to a live file, and finalizes it as a session's log."""
