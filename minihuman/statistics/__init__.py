"""Statistics over participants or runs: pure numbers in and out, from scipy."""
