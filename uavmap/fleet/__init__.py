"""Communication between members of a fleet: sealed datagrams over any radio.

    joining        its radio and seal; it communicates during its flight, and a while after
                                                                             .fleet_radio
      member       the times of messages, and the use of received ones       .member
        airspace   requested and agreed air                                  .airspace_leases
        peer       the state of another member, its clock, missing facts     .peer
      seal         accepted senders: key, starts, counters                   .sealing
      radio        carries datagrams: a multicast group, simulated air or zenoh
                                                   .radio, .simulated_radio, .zenoh_radio

`.codec` has the messages, `.knowledge` the members that know each fact. Nothing here commands a
vehicle.
"""
