"""Rating: an agent plays, and the person rates its behaviour as good or bad."""
