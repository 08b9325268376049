"""Seats: seating somebody at a session: a person at a window, a simulated one, a rehearsal, the demo."""
