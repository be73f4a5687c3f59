"""Members of a fleet talk to each other: sealed datagrams over whatever radio there is.

    talking        a member talks as long as its flight, and a while after   .exchange
      member       when we speak, and what becomes of what is heard          .member
        reports    which facts we tell next                                  .reports
        clock      the same seconds for all                                  .fleet_clock
        airspace   air that is asked for, and promised                       .airspace_leases
        peer       what we know of another one, and tell of our vehicle      .peer
      seal         who may be believed: key, starts, counters                .sealing
      radio        carries datagrams: simulated air, a multicast group or zenoh
                                  .radio, .simulated_radio, .multicast_radio, .zenoh_radio

What is said is in `missions.flight.team`. Nothing here commands a vehicle.
"""
