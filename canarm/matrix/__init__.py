"""The fault matrix: every fault at every tap that supports it, one run each, and what became of it."""
