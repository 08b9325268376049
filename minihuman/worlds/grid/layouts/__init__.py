"""Layouts: where everything stands at the start of an episode. One compiled function per family."""
