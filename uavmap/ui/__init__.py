"""What people and programs use: command line, Python interface, live page."""
