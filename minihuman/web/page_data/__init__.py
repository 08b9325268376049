"""Episodes that a page computed without a server: read them, replay them, and write them as session logs."""
