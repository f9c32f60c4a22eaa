"""Fine-tuning `plant2` to read signs."""
