"""Loops of studies, compiled as those of `missions.planning.kernels` are."""
