"""What may change a planned seam."""
