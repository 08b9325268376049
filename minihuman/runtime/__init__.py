"""Runs sessions: in a window, simulated, or as a demo, with devices and an experimenter's dashboard."""
