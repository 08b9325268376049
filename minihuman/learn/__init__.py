"""Agents (extra `learn`): policies trained by PPO, by cloning demonstrations and by teaching. Nothing else imports
this.
"""
