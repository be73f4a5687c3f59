"""Robots that look after each other: one moves while the others watch it.

After Rekleitis, Dudek and Milios, *Multi-robot exploration of an unknown environment*, 1997.

The ground is a polygon with holes, unknown at first. `trapezoids` sweeps it in stripes with two
robots or with a column of more, `triangulation` follows its walls where the range covers it; both
give an `exploration.Exploration`: the moves, and what any robot has seen. `tracking` says how well
the robots then know where they are, with the watching and without.
"""
