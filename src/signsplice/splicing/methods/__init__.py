"""Cutters, transitions and durations, classical and learned."""
