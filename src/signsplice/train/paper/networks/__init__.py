"""SPSN, TFGN, the rival systems and related transition makers, as torch modules."""
