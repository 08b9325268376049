"""Pathfinding: paths to a goal that consist of a world's real moves, and bounds on their length."""
