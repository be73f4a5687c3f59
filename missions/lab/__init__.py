"""Strategies of papers, and what measures them. No mission needs it; the core never imports it."""
