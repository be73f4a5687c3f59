"""Training of a detector from painted examples: samples, learners, selection, report."""
