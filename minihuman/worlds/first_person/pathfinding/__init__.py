"""Pathfinding: paths to a goal by the real moves, and bounds on their length."""
