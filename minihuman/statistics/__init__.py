"""Statistics over participants or training runs, computed with SciPy on plain numbers."""
