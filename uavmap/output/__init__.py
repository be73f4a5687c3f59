"""What is written of a mission: pictures, files, a report."""
