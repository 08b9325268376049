"""Teaching: policies that learn from a person's takeovers, corrections, comparisons and ratings."""
