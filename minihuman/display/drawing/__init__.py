"""Drawings of every screen of a session, as pure functions of the screen and the window's size."""
