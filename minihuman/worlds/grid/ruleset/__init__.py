"""Worlds whose rules and goal are drawn: things that change next to each other, in hand or next to the agent."""
