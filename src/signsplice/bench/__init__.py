"""Benchmarks: speed of every part, the service under load, and sentences in bulk."""
