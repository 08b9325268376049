"""What a session left behind, as values: no file is opened here and nothing is known of the log's format."""
