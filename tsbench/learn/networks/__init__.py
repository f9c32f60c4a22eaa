"""What all networks share: arithmetic that every processor answers alike, and what they see."""
