"""A study's server, its disk, clocks, database, network and participants in one thread: one seed repeats a run."""
