"""What everything above may use: lines for the operator, and the terminal that shows them."""
