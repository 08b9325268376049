"""The experimenter's dashboard of running sessions: read from their live logs, served on this machine only."""
