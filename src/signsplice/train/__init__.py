"""Training: networks, data, loop, checkpoints and export. The only room that imports torch."""
