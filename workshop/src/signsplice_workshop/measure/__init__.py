"""Measurements of methods, bodies, tempo and the corpus."""
