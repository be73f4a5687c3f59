"""The report of a flight: one page of HTML, and a PDF to print."""
