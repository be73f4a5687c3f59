"""Knowledge of the region: votes by cell, the exploration tree, reach over cells."""
