"""The simulator's sockets: UDP, TCP and HTTP on loopback."""
