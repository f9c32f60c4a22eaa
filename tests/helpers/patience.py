"""How long a test waits for what should happen at once: it ends what hangs, and measures nothing."""

HANG_S = 600.0
