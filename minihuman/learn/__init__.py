"""Agents (extra ``learn``): the transfer study, and demonstrations that train a policy. Nothing else imports this."""
