"""Teaching: policies that learn from a person who takes over, corrects, compares and rates."""
