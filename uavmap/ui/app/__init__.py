"""An operator's day in one page: it writes the files and runs the commands that a terminal has."""
