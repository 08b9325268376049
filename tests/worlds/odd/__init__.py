"""Small odd environments, each odd in one respect, and the contract that all of them are held to."""
