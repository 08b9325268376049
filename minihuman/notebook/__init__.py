"""What ``minihuman.open`` gives: a study, its sessions and their episodes, to be looked at from Python."""
