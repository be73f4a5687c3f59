"""What every room needs and no room owns: version, time, messages, text and files from outside."""
