"""The reducer's rules: the effects of events, and the next order of each vehicle."""
