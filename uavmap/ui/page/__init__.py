"""The live page of a flight: a map that grows in a browser, and the operator's orders from it."""
