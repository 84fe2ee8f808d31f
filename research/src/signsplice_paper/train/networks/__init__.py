"""The networks of the paper's systems as torch modules: SPSN, TFGN, the systems compared with, and related work."""
