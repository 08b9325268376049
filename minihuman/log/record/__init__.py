"""Recording: events appended to a live file, finished into a session's log."""
