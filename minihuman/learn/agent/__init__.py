"""One agent: what it observes, its network, how it is trained and kept."""
