"""Building: from rooms and passages to walls and faces."""
