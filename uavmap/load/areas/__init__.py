"""Areas drawn in other programs: their files are read, and a mission is planned over them."""
