"""Suites that every driver, every detector and every strategy passes."""
