"""The experimenter's dashboard of running sessions, which reads their live logs and is served on this machine only."""
