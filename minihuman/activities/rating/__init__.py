"""Rating: an agent plays, and the person says what is good and bad."""
