"""Episodes that a page computed without a server: read them, play them again, and write them as session logs."""
