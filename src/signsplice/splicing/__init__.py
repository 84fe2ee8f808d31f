"""The product: where to leave and enter signs, the frames between, and the engine that joins them."""
