"""The paper's protocol: its systems, measures, tables and figures; judges exported bundles, needs no torch."""
