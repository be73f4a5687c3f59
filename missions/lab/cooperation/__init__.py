"""Robots that look after each other: one moves while the others watch it.

After Rekleitis, Dudek and Milios, *Multi-robot exploration of an unknown environment*, 1997.

The ground is a polygon with holes that nobody knows at first. `trapezoids` sweeps it in stripes
with two robots or with a column of more, `triangulation` follows its walls where the range covers
it; both give an `exploration.Exploration`: who moved where, and who watched. `tracking` says how
well the robots then know where they are, with the watching and without, `table_1` what the paper
reckons, and `seen` what some robot has seen, without asking the explorer.
"""
