"""Worlds that are played in a notebook's cell: the cell's Python and its JavaScript module."""
