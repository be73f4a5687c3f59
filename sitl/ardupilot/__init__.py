"""How an ArduCopter behaves: modes, arming, failsafes."""
