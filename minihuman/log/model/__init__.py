"""What a session recorded, as values: no file is opened here and the log's format is unknown."""
