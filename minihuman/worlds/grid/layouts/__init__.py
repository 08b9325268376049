"""Layouts: where everything stands at the start of an episode, with one compiled function per family."""
