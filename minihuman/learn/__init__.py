"""Agents (the extra `learn`): policies trained by PPO, by cloning demonstrations and by teaching.

No other package of minihuman imports this one.
"""
