"""Where pictures come from: cameras, streams, folders, each behind
`uavmap.aircraft.cameras.source`.
"""
