"""Plans: expand a protocol into everything one participant's session will ask for."""
