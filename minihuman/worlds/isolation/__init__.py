"""Foreign worlds in processes of their own, so that a failure does not affect the session's process."""
