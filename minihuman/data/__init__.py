"""A study once it is read: sessions, marks, what counts, and its tables."""
