"""Record events to a live file, and finalize it into a session's log."""
