"""Kernels of the grid: state as plain arrays; rules, view and search as pure functions on them."""
