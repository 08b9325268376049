"""Drawings of every screen of a session: pure functions of the screen's values and of the window's size."""
