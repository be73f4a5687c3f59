"""What goes wrong on demand: kinds of faults, schedules, injection over MAVLink."""
