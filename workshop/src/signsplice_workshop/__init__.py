"""What makes and proves signsplice: corpora of true splices, the trainer of its networks, and its measures."""
