"""The behaviour of an ArduCopter: modes, arming, failsafes."""
