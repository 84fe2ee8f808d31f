"""The networks of the paper, its rivals and the transition makers that it cites, in plain PyTorch."""
