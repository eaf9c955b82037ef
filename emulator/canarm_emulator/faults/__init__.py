"""Fault injection: what can break at which tap of the signal path, when it does, and how that reaches the bench."""
