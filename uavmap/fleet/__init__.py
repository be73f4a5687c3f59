"""Members of a fleet talk to each other: sealed datagrams over whatever radio there is.

    talking        a member talks as long as its flight, and a while after   .talking
      member       when we speak, and what becomes of what is heard          .member
        presence   what we tell of our vehicle                               .presence
        telling    which facts we tell next                                  .telling
        clock      the same seconds for all                                  .fleet_clock
        airspace   air that is asked for, and promised                       .airspace
        peer       what we know of another one                               .peer
      seal         who may be believed: key, starts, counters                .sealing
      radio        carries datagrams: simulated air, a multicast group or zenoh
                                  .radio, .air, .multicast_radio, .zenoh_radio

What is said is in `missions.flight.team`. Nothing here commands a vehicle.
"""
