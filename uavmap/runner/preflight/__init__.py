"""What is looked at, and set, before anything takes off."""
