"""Robots that watch each other: one moves while the others observe it.

After Rekleitis, Dudek and Milios, *Multi-robot exploration of an unknown environment*, 1997. The
ground is a polygon with holes, unknown at first. `trapezoids` sweeps it in stripes with two robots
or with a column of more, `triangulation` follows its walls where the range covers it. Both give an
`exploration.Exploration`: the moves, and the ground that any robot has seen. `tracking` gives the
errors of the robots' positions, with and without the observation.
"""
