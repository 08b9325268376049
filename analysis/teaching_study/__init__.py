"""The teaching study: what takeovers, ratings and comparisons of simulated people are worth."""
