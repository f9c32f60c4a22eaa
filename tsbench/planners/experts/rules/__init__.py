"""What an expert knows of each rule: one guard a rule, in one file."""
