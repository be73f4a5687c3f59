"""Base that every package may use: version, time, messages, text and foreign files."""
