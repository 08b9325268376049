"""Grid worlds seen from inside: the grid's rules with a first-person picture."""
