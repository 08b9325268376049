"""Agents: the transfer study and learning from people (extra `learn`); nothing else imports this."""
