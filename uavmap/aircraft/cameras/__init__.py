"""Sources of pictures: cameras, streams, folders, each behind `uavmap.aircraft.cameras.source`."""
