"""Simulated recordings of a street with the exact motion of every point."""
