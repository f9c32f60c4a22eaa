"""Is this installation whole, is the data what it says, what can this machine do?"""
