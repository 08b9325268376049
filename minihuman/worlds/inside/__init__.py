"""A grid from inside: the grid's rules, a first-person picture."""
