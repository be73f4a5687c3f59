"""Where time, sockets, disks and people are: service, links, journal, results, command line."""

__version__ = "0.1.0"
