"""Pictures and films of episodes, one or many."""
