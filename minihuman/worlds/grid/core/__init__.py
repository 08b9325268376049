"""Kernels of the grid: the state as plain arrays; rules, view and search as pure functions on them."""
