"""Layouts: the rooms and entities of each world, with its rewards and the end of its episodes."""
