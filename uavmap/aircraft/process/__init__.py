"""The aircraft as a process of its own: orders in, events out, nothing else."""
