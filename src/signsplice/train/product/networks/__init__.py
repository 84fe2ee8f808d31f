"""The two networks that ship, as torch modules."""
