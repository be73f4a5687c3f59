"""Loops of studies, compiled as those of `missions.kernels` are."""
