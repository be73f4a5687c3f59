"""A fleet of members that each fly one vehicle: what they know of each other, and how it is said.

    own frames -> OwnVotes -> facts            which votes of ours can count     .own_votes
    facts of all <- Knowledge -> what is missing                                 .knowledge
    facts, presence <-> bytes                                                    .codec, .bits

Pure as all of `missions`: `uavmap.fleet` sends and receives the bytes.
"""
