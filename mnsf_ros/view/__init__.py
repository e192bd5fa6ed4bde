"""A recording or a running node, seen live or as an animation."""
