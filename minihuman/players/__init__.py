"""Players: whoever presses the keys when no human does."""
