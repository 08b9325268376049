"""Teaching: policies that learn from a person who takes over, compares and rates."""
