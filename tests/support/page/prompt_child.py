"""A process beside a flight whose first report is in the same write as its `ready`."""

import os
import sys

if __name__ == "__main__":
    os.write(sys.stdout.fileno(), b'{"ready": true}\n{"report": "no link yet"}\n')
    sys.stdin.buffer.read()
