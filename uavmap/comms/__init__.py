"""Members of a fleet talk to each other: sealed datagrams over whatever radio there is.

    member     what we say and when, what we have heard           .member
      seal     who may be believed: key, starts, counters         .sealing
      radio    carries datagrams: simulated air, or zenoh         .radio, .air, .zenoh_radio

What is said is in `missions.fleet`. Nothing here commands a vehicle.
"""
