"""The networks of the paper's systems as torch modules: SPSN, TFGN, and the systems compared with."""
