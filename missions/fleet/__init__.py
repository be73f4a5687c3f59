"""A fleet of members that each fly one vehicle: what they know of each other, and how it is said.

    own frames -> OwnCells -> facts            what our frames have decided      .own_cells
    facts of all <- Knowledge -> what is missing                                 .knowledge
    facts in any order -> the map of all                  missions.flight.joined
    facts, presence <-> bytes                                                    .codec, .bits

Pure as all of `missions`: `uavmap.fleet` sends and receives the bytes.
"""
