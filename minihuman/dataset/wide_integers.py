"""Whole numbers that a double rounds, as programs without 64-bit integers have it: R, Stata, SPSS, JavaScript."""

MAX_EXACT_INTEGER = 2**53  # a double holds every whole number up to this one
WIDE_INTEGERS = frozenset({"seed", "key_map_seed", "study_seed", "started_unix_ns"})  # columns that may exceed it
