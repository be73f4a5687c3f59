"""Strategies of papers, and their measures. No mission needs them; the core never imports them."""
