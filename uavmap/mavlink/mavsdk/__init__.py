"""The driver by MAVSDK: a second, independent implementation of MAVLink flies the aircraft.

The service keeps the link and the rules; MAVSDK, in a process of its own beside it, reads and
writes the bytes of the link.

    transport --bytes--> session --bytes--> child: MAVSDK --messages as JSON--> session: gate, view
    transport <--bytes-- outbox  <--bytes-- child: MAVSDK <--requests as JSON-- session, commands
"""
