"""Worlds by Wave Function Collapse: a small picture defines which cells may be adjacent, and the rest is random."""
