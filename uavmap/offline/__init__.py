"""What needs no aircraft: replay of photographs, figures, scores, results, trials."""
