"""One suite that every driver passes against both flavours of the simulator."""
