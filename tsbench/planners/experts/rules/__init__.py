"""What an expert does about each rule: one constraint, in the file of its name; other files are helpers of these."""
