"""Play: a block of episodes, with instructions, feedback and rest."""
