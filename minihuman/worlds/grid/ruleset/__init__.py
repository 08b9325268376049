"""Worlds whose rules and goal are drawn: things that change beside each other, in hand or beside the agent."""
