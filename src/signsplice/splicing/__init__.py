"""The product: cutters, transitions, and the engine that joins signs."""
