"""The interfaces: command line, Python, pages in a browser, TAK."""
