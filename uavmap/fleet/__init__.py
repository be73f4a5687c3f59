"""Members of a fleet talk to each other: sealed datagrams over whatever radio there is.

    joining        its radio and seal; it talks as long as its flight, and a while after
                                                                             .fleet_radio
      member       when we speak, and what becomes of what is heard          .member
        airspace   air that is asked for, and promised                       .airspace_leases
        peer       what we know of another one, its clock, what it lacks     .peer
      seal         who may be believed: key, starts, counters                .sealing
      radio        carries datagrams: a multicast group, simulated air or zenoh
                                                   .radio, .simulated_radio, .zenoh_radio

What is said is in `.codec`, by whom it is known in `.knowledge`. Nothing here commands a vehicle.
"""
