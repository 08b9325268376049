"""Reading: a log's file back to events, and to a session of episodes."""
