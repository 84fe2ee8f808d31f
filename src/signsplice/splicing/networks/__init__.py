"""Bundles, sessions and features: what a network sees and says."""
