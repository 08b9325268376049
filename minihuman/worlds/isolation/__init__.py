"""Foreign worlds in separate processes, so that a failure does not affect the session's process."""
