"""Grid worlds: state as plain arrays, rules and view as pure functions."""
