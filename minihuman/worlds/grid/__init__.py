"""Grid worlds: their state is plain arrays, their rules and views are pure functions."""
