"""Team: a block that people and agents play in one world with several bodies."""
