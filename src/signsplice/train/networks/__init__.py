"""The two networks of the product, as torch modules."""
