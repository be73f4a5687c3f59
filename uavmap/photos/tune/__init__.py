"""Learning a detector from painted examples: examples, samples, training, selection, report."""
