"""The paper's protocol, systems, metrics, tables and figures. Judges exported bundles; needs no torch."""
