"""The experimenter's view of running sessions: read from their live logs, shown on a page of this machine only."""
