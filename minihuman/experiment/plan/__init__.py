"""Plans: the expansion of a protocol into everything that one participant's session contains."""
