"""Run sessions: at a window, simulated, or as a demo, with devices and an experimenter's dashboard."""
